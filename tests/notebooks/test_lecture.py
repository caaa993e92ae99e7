"""Slides and figures from a notebook, and the agents of the small wheel."""

import sys
import zipfile

import execute
import lecture
import pytest
import wheel

from uavdh_lite.checkpoint import shipped_agents

SCRIPT = """# %% [markdown]
# # 9 · A test
#
# **What is seen?** A line, as one knows it. And more.

# %%
# %matplotlib inline
from matplotlib.figure import Figure
figure = Figure(figsize=(2, 1))
figure.subplots().plot([0, 1])
figure

# %% [markdown]
# The line **rises**. It is straight.
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
    (figure,) = lecture.write(notebook, "09_test", tmp_path)
    assert figure[0] == "09_test-1" and "<svg" in (tmp_path / "figures/09_test-1.svg").read_text()
    assert (tmp_path / "figures/09_test-1.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "slides" / "09_test.html").read_text()
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
def test_the_small_wheel_holds_the_package_and_the_agents_that_are_used(tmp_path, monkeypatch):
    others = [name for name in shipped_agents() if name != "manhattan_ddqn"]
    command = ["wheel.py", str(tmp_path), "--without", *others]
    monkeypatch.setattr(sys, "argv", command)
    assert wheel.main() == 0
    (made,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(made) as packed:
        names = packed.namelist()
    agents = [name for name in names if "checkpoints/" in name]
    assert agents == ["uavdh_lite/data/checkpoints/manhattan_ddqn.safetensors"]
    assert "uavdh_lite/course/checks/notebook_00.py" in names and made.stat().st_size < 12e6


def test_no_notebook_uses_an_agent_that_is_left_out():
    scripts = [*execute.scripts(), *execute.exercise_scripts()]
    text = "".join(script.read_text(encoding="utf-8") for script in scripts)
    assert not [name for name in wheel.UNUSED if f'"{name}"' in text]
    assert set(wheel.UNUSED) <= set(shipped_agents())
