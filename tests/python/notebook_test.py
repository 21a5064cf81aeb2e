"""The notebook of examples/ runs from its first cell to its last, and says what it printed."""

import contextlib
import io
import json
import os
import unittest
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

EXAMPLES = Path(os.environ["SERVOTWIN_EXAMPLES"])


class Notebook(unittest.TestCase):
    def test_runs(self):
        cells = json.loads((EXAMPLES / "servo_axis.ipynb").read_text())["cells"]
        before = Path.cwd()
        os.chdir(EXAMPLES)
        self.addCleanup(os.chdir, before)
        names = {}
        code = [cell for cell in cells if cell["cell_type"] == "code"]
        self.assertGreater(len(code), 3)
        for cell in code:
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec("".join(cell["source"]), names)
            said = "".join("".join(out["text"]) for out in cell["outputs"] if out.get("name") == "stdout")
            self.assertEqual(printed.getvalue(), said, "".join(cell["source"]))


if __name__ == "__main__":
    unittest.main()
