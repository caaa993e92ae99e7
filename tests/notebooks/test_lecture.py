"""Slides and figures from a notebook, and the folder that students get."""

import sys
import tomllib
import zipfile

import execute
import handout
import lecture
import nbformat
import pytest

from uavdh_lite.checkpoint import shipped_agents

SCRIPT = """# %% [markdown]
# # 9 · A test
#
# **What is seen?** A line, as one knows it. And more.

# %%
# The first cell begins with a comment, which is no heading

# %%
# %matplotlib inline
from matplotlib.figure import Figure
figure = Figure(figsize=(2, 1))
figure.subplots().plot([0, 1])
figure

# %% [markdown]
# Look at [the line](../docs/index.md). The line **rises**. It is straight.
#
# ## 9.1 Words alone
#
# One sentence. Another with $x^2$. A third. A fourth.
#
# | a | table |
# | --- | --- |

# %%
# a comment, which is no heading
1 + 1

# %% [markdown]
# ## Recap
#
# - It rises.
#
# ## Exercises
#
# Some.
"""


def test_a_slide_is_a_section_with_its_figure_and_the_sentence_about_it(tmp_path, monkeypatch):
    script = tmp_path / "09_test.py"
    script.write_text(SCRIPT)
    monkeypatch.setattr(lecture, "HERE", tmp_path)
    notebook = lecture.executed(script)
    slides = lecture.slides_of(notebook)
    assert [(heading, text, bool(data)) for heading, text, data in slides] == [
        ("9 · A test", "What is seen? A line, as one knows it.", True),
        ("9.1 Words alone", "One sentence. Another with $x^2$. A third.", False),
        ("Recap", "\n- It rises.\n\n", False),
    ]
    for name in ("slides", "figures"):
        (tmp_path / name).mkdir()
    (figure,) = lecture.write(notebook, "09_test", tmp_path, "draw()")
    assert figure[0] == "09_test-1" and "<svg" in (tmp_path / "figures/09_test-1.svg").read_text()
    assert (tmp_path / "figures/09_test-1.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "slides" / "09_test.html").read_text()
    assert "<script>draw()</script>" in page and "src=" not in page.replace('src="data:', "")
    assert page.count("<section") == 3 and "<li>It rises.</li>" in page
    assert '<img alt="What is seen? A line, as one knows it." src="data:image/png' in page


def test_what_is_missing_is_named_with_the_command_that_installs_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(lecture, "find_spec", lambda name: None)
    for numbers, said in ((["4"], "no notebook 4"), (["04"], r"pip install -e '.[docs]'")):
        monkeypatch.setattr(sys, "argv", ["lecture.py", str(tmp_path), *numbers])
        with pytest.raises(SystemExit):
            lecture.main()
        assert said in capsys.readouterr().err


@pytest.mark.long
def test_the_handout_holds_the_notebooks_and_a_small_wheel(tmp_path, monkeypatch):
    others = [name for name in shipped_agents() if name != "manhattan_ddqn"]
    monkeypatch.setattr(sys, "argv", ["handout.py", str(tmp_path), "--without", *others])
    assert handout.main() == 0
    (made,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(made) as packed:
        names = packed.namelist()
    agents = [name for name in names if "checkpoints/" in name]
    assert agents == ["uavdh_lite/data/checkpoints/manhattan_ddqn.safetensors"]
    assert "uavdh_lite/course/checks/notebook_00.py" in names and made.stat().st_size < 12e6
    assert len(list(tmp_path.glob("notebooks/exercises/*/*.ipynb"))) == len(
        execute.exercise_scripts()
    )


def test_a_notebook_needs_nothing_but_the_small_wheel():
    """What each read when it was executed is in the wheel; the package says where that is."""
    included = tomllib.loads((handout.ROOT / "pyproject.toml").read_text())["tool"]["hatch"]
    shipped = tuple(included["build"]["targets"]["wheel"]["force-include"])
    left_out = [f"data/checkpoints/{name}.safetensors" for name in handout.UNUSED]
    assert set(handout.UNUSED) <= set(shipped_agents())
    for script in execute.scripts() + execute.exercise_scripts() + execute.project_scripts():
        notebook = nbformat.read(execute.notebook_of(script), as_version=4)
        read = [f"data/{path}" for path in notebook.metadata.uavdh_lite.read]
        assert all(path.startswith(shipped) and path not in left_out for path in read), script
        code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
        assert not any("../" in source for source in code[1:]), script
