"""Slides and figures from a notebook, and the folder that students get."""

import base64
import re
import shutil
import sys
import tomllib
import zipfile

import execute
import handout
import lecture
import nbformat
import pytest

from uavdh_lite.checkpoint import shipped_agents

PROSE = (
    """# 9 · A test

**What is seen?** A line.
""",
    """Look at [the line](../docs/index.md). The line **rises**. It is straight.

## 9.1 Words

One sentence. Another with $x^2$.

$$y = x$$

<details><summary>Folded</summary>

Hidden.
</details>
""",
    """## Recap

- It rises. It does.

## Exercises

Some.
""",
)
PICTURE = base64.b64encode(b"\x89PNG").decode()


def a_notebook():
    new, shown = nbformat.v4, {"image/png": PICTURE}
    code = new.new_code_cell("draw()", outputs=[new.new_output("display_data", shown)])
    said = new.new_code_cell("print(1)", outputs=[new.new_output("stream", text="1\n")])
    said.metadata.tags = ["slide-code"]
    left_out = new.new_code_cell("print(2)", outputs=[new.new_output("stream", text="2\n")])
    left_out.metadata.tags = ["no-slide"]
    first, second, last = map(new.new_markdown_cell, PROSE)
    return new.new_notebook(cells=[first, code, second, said, left_out, last])


def test_a_slide_has_a_section_s_formulas_terms_and_outputs_and_its_prose_in_the_notes():
    slides = lecture.slides_of(a_notebook())
    assert slides.metadata.title == "9 · A test"
    shown = [
        (cell.metadata.slideshow.slide_type, cell.source) if "slideshow" in cell.metadata else cell
        for cell in slides.cells
    ]
    kinds = [one[0] for one in shown if isinstance(one, tuple)]
    assert kinds.count("slide") == 3 and kinds.count("notes") == 4
    text = [one[1] for one in shown if isinstance(one, tuple) and one[0] != "notes"]
    assert "**What is seen?**" in text[0] and "- The line **rises**." in text[1]
    assert "$$y = x$$" in text[2] and "Hidden" not in text[2]
    assert text[3] == "```python\nprint(1)\n```" and "- It rises. It does." in text[4]
    outputs = [o for cell in slides.cells for o in cell.get("outputs", ())]
    assert len(outputs) == 2 and not any("Some." in source for source in text)


def test_a_deck_is_one_file_that_loads_nothing(tmp_path, monkeypatch, capsys):
    script = tmp_path / "09_test.py"
    nbformat.write(a_notebook(), tmp_path / "09_test.ipynb")
    monkeypatch.setattr(lecture, "scripts", lambda: [script])
    monkeypatch.setattr(lecture, "notebook_of", lambda script: script.with_suffix(".ipynb"))
    monkeypatch.setattr(sys, "argv", ["lecture.py", str(tmp_path), "09"])
    lecture.main()
    page = (tmp_path / "slides" / "09_test.html").read_text()
    assert capsys.readouterr().out == "09_test: 3 slides, 1 figures\n"
    html = re.sub("(?s)<script>.*?</script>", "", page)
    assert not re.search(r"src=.(?!data:)|<link", html) and 'alt="Look at the line."' in html
    assert "Reveal.initialize" in page and "MathJax" in page and '<aside class="notes">' in page
    assert "draw()" not in page and f"data:image/png;base64,{PICTURE}" in page
    assert (tmp_path / "figures" / "09_test-1.png").read_bytes() == b"\x89PNG"


@pytest.mark.parametrize("number", lecture.COURSE)
def test_there_are_slides_enough_for_a_lecture_and_not_too_many(number):
    (script,) = (script for script in execute.scripts() if script.name[:2] == number)
    slides = lecture.slides_of(nbformat.read(execute.notebook_of(script), as_version=4))
    kinds = [c.metadata.get("slideshow", {}).get("slide_type") for c in slides.cells]
    assert 8 <= kinds.count("slide") <= 20


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
        sources = [packed.read(name).decode(errors="ignore") for name in names if _is_text(name)]
    agents = [name for name in names if "checkpoints/" in name]
    assert agents == ["uavdh_lite/data/checkpoints/manhattan_ddqn.safetensors"]
    assert "uavdh_lite/course/checks/notebook_00.py" in names and made.stat().st_size < 12e6
    sheets = list(tmp_path.glob("notebooks/exercises/*/*.ipynb"))
    assert len(sheets) == len(execute.exercise_scripts())
    handed = [path.read_text() for path in tmp_path.rglob("*") if path.suffix in (".ipynb", ".md")]
    text = "\n".join(sources + [part.replace("\\n", "\n").replace('\\"', '"') for part in handed])
    assert not [one for one in secrets() if one in _plain(text)]


@pytest.mark.parametrize(
    "copy",
    [
        lambda text, path: path.write_text(text.replace("raise N", "return 1\\n    raise N", 1)),
        lambda text, path: path.with_stem("mine").write_text(text),
        lambda text, path: shutil.copy(str(path).replace("exercises", "solutions"), path),
    ],
)
def test_an_exercise_in_which_somebody_has_written_is_not_handed_out(tmp_path, monkeypatch, copy):
    stem, own = "01_city_and_channel", tmp_path / "own"
    for name in (f"exercises/{stem}", f"solutions/{stem}"):
        shutil.copytree(handout.ROOT / "notebooks" / name, own / "notebooks" / name)
    (own / "docs" / "how_to").mkdir(parents=True)
    (own / "docs" / "how_to" / "install.md").touch()
    monkeypatch.setattr(handout, "ROOT", own)
    handout.copy_sheets(tmp_path)
    path = own / "notebooks" / "exercises" / stem / f"{stem}.ipynb"
    copy(path.read_text(), path)
    with pytest.raises(SystemExit, match="Has somebody filled it in"):
        handout.copy_sheets(tmp_path)


def _is_text(name):
    """Of the wheel; the checks compare with solutions of their own, which the guide says."""
    return name.endswith((".py", ".md", ".toml", ".txt")) and "/course/checks/" not in name


def _plain(text):
    return " ".join(text.replace('",', "").replace('"', "").split())


def secrets():
    """What no student may get: each solution of more than a line, each sentence for teachers."""
    found = []
    for path in (handout.ROOT / "notebooks" / "scripts" / "exercises").glob("*.py"):
        found += re.findall(r"(?s)### BEGIN SOLUTION\n(.*?) *### END SOLUTION", path.read_text())
    found = [one for one in found if one.count("\n") > 2]
    for path in (handout.ROOT / "docs" / "teach").glob("*.md"):
        lines = path.read_text().splitlines()
        found += [one for one in lines if len(one) > 100 and not one.startswith(("|", "#", " "))]
    assert len(found) > 60
    return [_plain(one) for one in found]


def test_a_notebook_needs_nothing_but_the_small_wheel():
    """What each read when it was executed is in the wheel; the package says where that is."""
    included = tomllib.loads((handout.ROOT / "pyproject.toml").read_text())["tool"]["hatch"]
    shipped = tuple(included["build"]["targets"]["wheel"]["force-include"])
    left_out = [f"data/checkpoints/{name}.safetensors" for name in handout.UNUSED]
    assert set(handout.UNUSED) <= set(shipped_agents())
    for script in execute.scripts() + execute.exercise_scripts() + execute.project_scripts():
        notebook = nbformat.read(execute.notebook_of(script), as_version=4)
        read = [f"data/{path}" for path in notebook.metadata.uavdh_lite.read]
        code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
        if any("Lab(" in source for source in code):  # it offers whichever agents there are
            read = [path for path in read if path not in left_out]
        assert all(path.startswith(shipped) and path not in left_out for path in read), script
        assert not any("../" in source for source in code[1:]), script
