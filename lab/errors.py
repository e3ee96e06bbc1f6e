"""The exceptions that say in a sentence what a person has to know: wrong input, and a cluster that went away.

Question answered: what does the command line turn into one line and a status?  In a file of its own, since the command
line needs it before it needs numpy.
"""


class InputError(ValueError):
    """Something given from outside cannot be used; the message is one sentence for a person."""


class ClusterError(Exception):
    """The cluster went away under the work: one sentence."""
