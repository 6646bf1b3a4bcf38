"""headway: which reading, of which sensor, of which car, cannot be true.

>>> from headway import Detector
>>> detector = Detector(alarm_budget_per_hour=1.0)
"""

from typing import TYPE_CHECKING, Any

from headway import kernel_cache

if TYPE_CHECKING:
    from headway.detector import Detector
    from headway.result import Result
    from headway.sample import sample_recording

__all__ = ["Detector", "Result", "__version__", "sample_recording"]

kernel_cache.use()


def __getattr__(name: str) -> Any:
    """Import what the public API needs when it is asked for: a command that does not detect starts at once."""
    if name == "Detector":
        from headway.detector import Detector  # noqa: PLC0415

        return Detector
    if name == "Result":
        from headway.result import Result  # noqa: PLC0415

        return Result
    if name == "sample_recording":
        from headway.sample import sample_recording  # noqa: PLC0415

        return sample_recording
    if name == "__version__":
        from headway.version import version  # noqa: PLC0415

        return version()
    raise AttributeError(f"module 'headway' has no attribute {name!r}")
