"""The one base class of every error that a user can cause and can mend."""


class RescoreError(Exception):
    """Bad input. The message says what was expected, what came and what to do, in one line."""
