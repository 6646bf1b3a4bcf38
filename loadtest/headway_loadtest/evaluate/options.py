"""The error of all evaluations for options that they cannot run with."""


class OptionError(ValueError):
    """An option with an impossible value: one line that says what is wrong and what to write instead."""
