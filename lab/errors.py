"""The one exception that says why something given from outside cannot be used.

Question answered: what does the command line turn into one line and status 2?  In a file of its own, since the command
line needs it before it needs numpy.
"""


class InputError(ValueError):
    """Something given from outside cannot be used; the message is one sentence for a person."""
