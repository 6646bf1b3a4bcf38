"""What the user of a command can mend."""


class UserError(Exception):
    """One line: what is wrong and what to do. A command that meets it ends with status 2."""
