"""Solutions executed from the first cell to the last, their outputs stored without what differs from run to run.

Question answered: which outputs does nbval compare with?  Counts 1..n from a fresh kernel of this interpreter, streams
joined, no timing, no widget state (a slider is stored as the still picture that stands in for it).  The first picture
of a cell ``KEY-show`` becomes ``expected/KEY.png``, which the question and the student's unanswered cell show.
"""

import base64
import re
import sys
from pathlib import Path
from typing import Any

from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from lab.release.course import EXPECTED
from lab.release.student import METADATA, Notebook, as_text, check_cells, node, read_notebook
from lab.validation import InputError

TIMEOUT = 600  # seconds for one cell
WIDGET = "application/vnd.jupyter.widget-view+json"
PICTURE = re.compile(r'src="data:image/png;base64,([^"]+)"')
SHOWN = "-show"


def execute(path: Path) -> None:
    """Run a solution notebook in its folder and store its outputs, and its expected pictures beside it.

    Parameters
    ----------
    path : Path
        Rewritten only when every cell has run.

    Raises
    ------
    InputError
        A cell raised, or wrote to standard error; the message names notebook and cell.
    """
    notebook = read_notebook(path)
    check_cells(notebook, path.name)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    try:
        run(notebook, path.parent)
    except CellExecutionError as error:
        raise InputError(f"{path.name}: a cell raised.\n{error}") from None
    normalise(notebook, path.name)
    path.write_bytes(as_text(notebook).encode())
    for key, picture in pictures(notebook).items():
        target = path.parent / EXPECTED / f"{key}.png"
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(picture)


def run(notebook: Notebook, folder: Path, *, go_on: bool = False) -> None:
    """Execute a notebook in place, with a kernel of this very interpreter.

    Parameters
    ----------
    notebook : NotebookNode
    folder : Path
        Where the kernel starts.
    go_on : bool
        Whether the cells after one that raised are run as well.
    """
    specs = KernelSpecManager()
    specs.kernel_dirs = []  # a kernel "python3" that somebody installed for another interpreter is not meant
    client = NotebookClient(
        notebook,
        km=AsyncKernelManager(kernel_name="python3", kernel_spec_manager=specs),
        extra_arguments=["--log-level=ERROR"],  # its warning about unencrypted ports on this machine
        timeout=TIMEOUT,
        allow_errors=go_on,
        record_timing=False,
        store_widget_state=False,
        coalesce_streams=True,
        resources={"metadata": {"path": str(folder)}},
    )
    if sys.platform == "win32":  # pyzmq wants the other event loop there
        import asyncio

        asyncio.set_event_loop_policy(asyncio.WindowsSelectorEventLoopPolicy())  # type: ignore[attr-defined]
    client.execute()


def normalise(notebook: Notebook, name: str) -> None:
    """Take out of an executed notebook, in place, what is not a result.

    Raises
    ------
    InputError
        A cell wrote to standard error.
    """
    notebook.metadata = node(METADATA)
    for cell in notebook.cells:
        for key in set(cell.metadata) - {"nbgrader", "tags"}:
            del cell.metadata[key]
        for output in cell.get("outputs", []):
            if output.get("name") == "stderr":
                raise InputError(f"{name}, cell {cell.id} writes to standard error: {output.text.strip()}")
            if "data" in output:
                output.data.pop(WIDGET, None)
                output.metadata = node({})


def pictures(notebook: Notebook) -> dict[str, bytes]:
    """Return the first picture of every cell ``KEY-show``, as PNG, by KEY."""
    found: dict[str, bytes] = {}
    for cell in notebook.cells:
        texts: list[Any] = [output.get("data", {}).get("text/html", "") for output in cell.get("outputs", [])]
        match = PICTURE.search("".join(texts))
        if cell.id.endswith(SHOWN) and match:
            found[cell.id.removesuffix(SHOWN)] = base64.b64decode(match[1])
    return found
