from pathlib import Path

import numpy as np
import pytest

from headway_loadtest.evaluate.paper.leader import HEAD_START_M, INTERVAL_S, Leader

SAMPLES = 600


@pytest.fixture(scope="session")
def leader() -> Leader:
    """Stop-and-go for a minute: two waves of different length, standing at times."""
    t_s = INTERVAL_S * np.arange(SAMPLES)
    v_mps = np.maximum(0.0, 9.0 + 7.0 * np.sin(0.21 * t_s) + 4.0 * np.sin(0.53 * t_s + 1.0))
    x_m = np.cumsum(INTERVAL_S * v_mps)
    return Leader(x_m - x_m[0] + HEAD_START_M, v_mps)


@pytest.fixture
def leader_csv(leader: Leader, tmp_path: Path) -> Path:
    """The same drive as a file."""
    path = tmp_path / "leader.csv"
    rows = [f"{t:.1f},{x:.6f},{v:.6f}" for t, x, v in zip(leader.t_s, leader.x_m, leader.v_mps, strict=True)]
    path.write_text("\n".join(["t_s,x_m,v_mps", *rows]) + "\n", encoding="utf-8")
    return path
