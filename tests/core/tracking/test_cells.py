"""The lattice: each place has one owner, and all owners within the halo receive it."""

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from headway.core.tracking.cells import Lattice


@pytest.mark.parametrize("engines", [1, 2, 3, 8])
@pytest.mark.parametrize("lat", [-54.0, 0.0, 42.0, 64.0])
def test_all_owners_within_the_halo_receive_a_place(engines: int, lat: float) -> None:
    lattice, rng = Lattice(engines, 1000.0, 300.0), np.random.default_rng(1)
    for _ in range(30):
        place = lat + rng.uniform(-0.5, 0.5), rng.uniform(-170.0, 170.0)
        receivers = int(lattice.receivers(*(np.array([of]) for of in place))[0])
        assert receivers < 1 << engines
        near = [Geodesic.WGS84.Direct(*place, rng.uniform(0.0, 360.0), rng.uniform(0.0, 295.0)) for _ in range(50)]
        owners = lattice.owners(np.array([of["lat2"] for of in near]), np.array([of["lon2"] for of in near]))
        assert all(receivers >> owner & 1 for owner in owners.tolist())


def test_engines_take_turns_along_roads_to_the_north_and_to_the_east() -> None:
    lattice, along = Lattice(3, 1000.0, 300.0), np.arange(0.0, 0.3, 1e-3)
    for lat, lon in ((42.0 + along, np.full(along.size, -83.0)), (np.full(along.size, 42.0), -83.0 + along)):
        owners = lattice.owners(lat, lon)
        changes = owners[1:][np.diff(owners) != 0]
        assert set(np.diff(changes) % 3) == {1}
        assert np.bincount(owners).min() > 0.25 * owners.size


def test_a_cell_below_two_halos_is_refused() -> None:
    with pytest.raises(ValueError, match="smaller than two halos"):
        Lattice(2, 500.0, 300.0)
