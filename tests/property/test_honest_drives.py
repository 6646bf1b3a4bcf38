"""No honest drive breaks a physical limit, whatever ordinary receiver it is seen through."""

import numpy as np
from core.plausibility.sender import Drive, observed
from hypothesis import given, settings
from hypothesis import strategies as st

N = 1200

receivers = st.fixed_dictionaries(
    {
        "fix_every": st.sampled_from([1, 1, 2, 5, 10]),  # messages from one position to the next
        "repeated": st.sampled_from([0.0, 0.1]),  # share of positions that are the one before
        "white_m": st.floats(0.0, 0.5),
        # A Gaussian walk has no bound: at 3 m one drive of two minutes in fifty breaks a limit.
        "walk_m": st.floats(0.0, 2.0),
        "scale": st.floats(0.96, 1.04),
        "resolution_mps": st.sampled_from([0.02, 0.1, 0.27777, 0.44704]),
        "noise_mps": st.floats(0.0, 0.2),
        "age_s": st.floats(0.0, 0.5),
        "jitter_s": st.sampled_from([0.0, 0.01, 0.03]),
        "lost": st.sampled_from([0.0, 0.3]),
    }
)


def walk(rng, std, tau_s=30.0):
    kept = np.exp(-0.1 / tau_s)
    steps, at = rng.normal(0, std * np.sqrt(1 - kept**2), N), np.zeros(N)
    for k in range(1, N):
        at[k] = kept * at[k - 1] + steps[k]
    return at


@settings(max_examples=60, derandomize=True)
@given(st.integers(0, 2**32 - 1), receivers)
def test_honest_drives_break_no_limit(seed, of):
    rng = np.random.default_rng(seed)
    corners = rng.choice([0.0, 0.0, 8.0, 15.0, 28.0], 8)
    t_s = 0.1 * np.arange(N)
    v, wanted = np.zeros(N), np.interp(t_s, np.linspace(0, 120, 8), corners)
    for k in range(1, N):
        v[k] = max(v[k - 1] + np.clip(wanted[k] - v[k - 1], -0.8, 0.4), 0.0)
    turn = np.where(rng.random(N // 60).repeat(60) < 0.2, 2.5 / np.maximum(v, 5.0), 0.0) * (v > 0.5)
    drive = Drive(rng, v, turn)
    aged = t_s - of["age_s"]
    for name in ("east_m", "north_m"):
        seen = np.interp(aged, t_s, getattr(drive, name)) + walk(rng, of["walk_m"]) + rng.normal(0, of["white_m"], N)
        setattr(drive, name, seen)
    fix = np.arange(N) // of["fix_every"] * of["fix_every"]
    again = rng.random(N) < of["repeated"]
    for k in np.flatnonzero(again[1:]) + 1:
        fix[k] = fix[k - 1]
    drive.east_m, drive.north_m = drive.east_m[fix], drive.north_m[fix]
    drive.v_mps = np.maximum(v * of["scale"] + rng.normal(0, of["noise_mps"], N), 0)
    drive.v_mps = np.round(drive.v_mps / of["resolution_mps"]) * of["resolution_mps"]
    drive.t_s = t_s + rng.normal(0, of["jitter_s"], N).clip(-0.045, 0.045)
    kept = rng.random(N) >= of["lost"]
    for name in (
        "t_s",
        "east_m",
        "north_m",
        "v_mps",
        "heading_deg",
        "accuracy_m",
        "contradictions",
        "overlapped",
        "appeared",
    ):
        setattr(drive, name, getattr(drive, name)[kept])
    judged = drive.check()
    assert observed(judged) == set()
