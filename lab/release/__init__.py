"""From the instructors' notebooks to the students': solutions/*.ipynb -> notebooks/*.ipynb, and a bundle to hand out.

Question answered: what may a student see?  One source, ``solutions/``, carries nbgrader's markers and metadata (schema
3), so that a course on nbgrader takes it as it is, and this package does alone what nbgrader's assignment step does:

    solution regions       replaced by a stub          hidden tests, mark schemes    removed
    outputs, counts        removed                     graded and locked cells       protected

Everything is deterministic to the byte: cell ids are those of the source, metadata are reduced to what is meant.
Called by ``slam-lab release`` and ``make solutions``.
"""

from lab.release.bundle import write_bundle
from lab.release.course import Course, find_course
from lab.release.execute import execute
from lab.release.regions import cleared, regions
from lab.release.student import Mark, as_text, marks, read_notebook, student_copy

__all__ = [
    "Course",
    "Mark",
    "as_text",
    "cleared",
    "execute",
    "find_course",
    "marks",
    "read_notebook",
    "regions",
    "student_copy",
    "write_bundle",
]
