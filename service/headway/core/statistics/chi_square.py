"""Gates of the chi-square distribution."""


def chi_square_gate(degrees: int, share: float) -> float:
    """Return the value that a statistic of so many degrees of freedom exceeds with probability `share`."""
    from scipy.special import chdtri  # noqa: PLC0415 - 14 MB that only the simple models need

    return float(chdtri(degrees, share))
