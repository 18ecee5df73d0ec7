"""The two ways in which a request can end badly."""


class UserError(Exception):
    """Something in the request cannot be: the message says what, and how to mend it (exit code 2)."""


class RunError(Exception):
    """A run that started well cannot go on: the message says when and where (exit code 1)."""
