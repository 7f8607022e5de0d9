"""Shows how far a job is, in one line where somebody looks: a notebook or a terminal."""

import sys


def line():
    """A line to tell, for whoever looks; None where nobody does."""
    notebook = _notebook()
    if notebook is not None:
        return _InNotebook(notebook)
    if sys.stderr is not None and sys.stderr.isatty():
        return _InTerminal(sys.stderr)
    return None


def _notebook():
    """IPython.display within a notebook; nothing is imported that is not there already."""
    ipython = sys.modules.get("IPython")
    shell = ipython and ipython.get_ipython()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    import IPython.display

    return IPython.display


def words(text, share):
    """`fitting, 40 % done`; the text alone where no share can be told."""
    return text if share is None else f"{text}, {100 * share:.0f} % done"


class _InTerminal:
    def __init__(self, out):
        self.out = out
        self.width = 0

    def __call__(self, text, share):
        said = words(text, share)
        self.out.write("\r" + said.ljust(self.width))
        self.out.flush()
        self.width = len(said)

    def close(self):
        """Takes the line away."""
        self.out.write("\r" + " " * self.width + "\r")
        self.out.flush()


class _InNotebook:
    def __init__(self, display):
        self.display = display
        self.handle = None

    def __call__(self, text, share):
        said = {"text/plain": words(text, share)}
        if self.handle is None:
            self.handle = self.display.display(said, raw=True, display_id=True)
        else:
            self.handle.update(said, raw=True)

    def close(self):
        """Takes the line away."""
        if self.handle is not None:
            self.handle.update({"text/plain": ""}, raw=True)
