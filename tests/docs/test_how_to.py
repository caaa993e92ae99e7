"""The how-to guides: every block of code runs, page by page, from top to bottom."""

import shlex
from pathlib import Path

import pytest

from uavdh_lite.cli.main import main
from uavdh_lite.course.checks import exercise

markdown_it = pytest.importorskip("markdown_it")
for package in ("distributed", "gymnasium", "onnxruntime", "psutil", "stable_baselines3"):
    pytest.importorskip(package)
pytest.importorskip("tensorboard")

pytestmark = pytest.mark.long

PAGES = sorted((Path(__file__).parents[2] / "docs" / "how_to").glob("[!i]*.md"))
COMMAND = ["python", "-m", "uavdh_lite"]
SHOWN_ONLY = "text"  # what needs other machines


def blocks(page: Path) -> list[tuple[int, str, str]]:
    """Line, language and content of each fenced block."""
    tokens = markdown_it.MarkdownIt().parse(page.read_text(encoding="utf-8"))
    return [
        (token.map[0] + 1, token.info.strip(), token.content)
        for token in tokens
        if token.type == "fence"
    ]


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_of_a_guide_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(exercise, "EXERCISES", {})  # a guide adds one
    names = {"__name__": "__main__"}
    for line, language, content in blocks(page):
        if language == "python":
            exec(compile("\n" * line + content, str(page), "exec"), names)
        elif language == "bash":
            for command in content.replace("\\\n", "").splitlines():
                words = shlex.split(command)
                assert words[:3] == COMMAND, f"{page}:{line}: cannot run {command!r}"
                assert main(words[3:]) == 0, f"{page}:{line}: {command}"
        else:
            assert language == SHOWN_ONLY, f"{page}:{line}: a block in {language!r} is not run"


def test_little_is_only_shown():
    shown = [page.stem for page in PAGES for _, language, _ in blocks(page) if language == "text"]
    assert shown == ["study", "train_and_resume"]
