"""README.md as pasted: its commands one after the other, in a fresh environment, in a fresh copy of the project."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy without anything that git does not know."""
    folder = tmp_path_factory.mktemp("readme") / "pbd-warp"
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    for name in files:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_symlink():
            target.symlink_to((ROOT / name).readlink())
        elif (ROOT / name).exists():
            target.write_bytes((ROOT / name).read_bytes())
    return folder


def paste(script, project):
    """In a shell of its own, where the libraries of this environment count as installed already; not so the project."""
    libraries = project.parent / "libraries"
    if not libraries.exists():
        libraries.mkdir()
        here = Path(next(p for p in sys.path if p.endswith("site-packages")))
        for library in here.iterdir():
            if not library.name.startswith("pbd_warp"):
                (libraries / library.name).symlink_to(library)
    environment = {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "HOME": str(Path.home())}
    return subprocess.run(
        ["bash", "-euc", script],
        cwd=project, env=environment | {"PYTHONPATH": str(libraries)}, capture_output=True, text=True, timeout=500,
    )  # fmt: skip


def test_the_commands_work_one_after_the_other(project):
    install, tests = blocks("sh")
    assert tests == "pip install '.[test]' && pytest\n"
    said = paste(install, project)
    assert said.returncode == 0, said.stderr
    assert (project / "rope.html").read_text().startswith("<!doctype html>")
    assert "times real time" in said.stdout
    for noise in ("Warp 1", "CUDA", "Module ", "Devices"):
        assert noise not in said.stdout + said.stderr, said
    inside = ". .venv/bin/activate\n"
    for command in ("pbd-warp list", "pbd-warp info rope", "pbd-warp run chain --accuracy 1e-3"):
        assert f"`{command}`" in README
        said = paste(inside + command, project)
        assert said.returncode == 0, said.stderr
        assert said.stderr == "", command
    (project / "program.py").write_text(*blocks("python"))
    said = paste(
        inside + "python program.py\npbd-warp run rope --frames 5\npbd-warp play rope.usda --out r.html", project
    )
    assert said.returncode == 0, said.stderr
    assert (project / "swing.html").exists()
    assert (project / "r.html").exists()
    where = paste(inside + "cd / && python -c 'import pbd_warp; print(pbd_warp.__file__)'", project)
    assert where.stdout.startswith(str(project / ".venv")), "another copy was tried"


def test_every_command_that_is_named_exists():
    named = set(re.findall(r"pbd-warp ([a-z]+)", README + (ROOT / "docs" / "guide.md").read_text(encoding="utf-8")))
    files = {path.stem for path in (ROOT / "pbd_warp" / "cli").glob("*.py")}
    assert named <= files, named - files
    assert {"run", "view", "play", "list", "info", "chart", "simulate", "stability"} <= named


def test_the_gallery_is_what_its_script_makes():
    """Its programs, that is: pictures are not made again."""
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    script = (ROOT / "docs" / "gallery.py").read_text(encoding="utf-8")
    programs = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1:]
    assert len(programs) >= 12
    for program in programs:
        first = program.splitlines()[1]
        assert first.strip() in script
        compile(program, "gallery.md", "exec")
    for picture in re.findall(r"\((gallery/[a-z_]+\.png)\)", page):
        assert 0 < (ROOT / "docs" / picture).stat().st_size < 100_000
