"""The notebooks of `examples/notebooks` run from beginning to end."""

from pathlib import Path

import pytest

nbclient = pytest.importorskip("nbclient", reason="pip install 'boresight[notebooks]'")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")
pytest.importorskip("matplotlib")

FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_they_are_there_and_hold_no_results():
    assert len(NOTEBOOKS) == 5
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        for cell in notebook.cells:
            assert cell.cell_type != "code" or (not cell.outputs and cell.execution_count is None), path.name


# Far more than the minute that each takes at most on two idle cores.
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    said = "".join(
        output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []) if output.output_type == "stream"
    )
    shown = [output for cell in notebook.cells for output in cell.get("outputs", []) if output.output_type == "display_data"]
    assert said and shown
    for words in SAYS.get(path.stem, ()):
        assert words in said, said


#: What shows that a notebook does what it says.
SAYS = {
    "1_first_run": ("neutralised after", "when the other one fires"),
    "2_own_detector": ("<Track ",),
    "3_own_law": ("tuned", "with_integral"),
    "4_dataset_and_training": ("of a run that it has not seen", "the UAV is falling"),
    "5_swarm_statistics": ("twice the power stops",),
}
