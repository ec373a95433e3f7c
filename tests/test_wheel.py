"""The wheel: one copy of every file, nothing global but pbd_warp, and it runs where nothing else is."""

import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    # From a copy, so that neither old build folders get in nor new ones stay behind.
    source = folder / "source"
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.split()  # fmt: skip
    for name in files:
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_symlink():
            target.symlink_to((ROOT / name).readlink())
        elif (ROOT / name).exists():
            target.write_bytes((ROOT / name).read_bytes())
    subprocess.run([sys.executable, "-m", "build", "--wheel", "--outdir", folder, source], check=True)
    return next(folder.glob("*.whl"))


def test_contents(wheel):
    names = [n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n]
    assert len(names) == len(set(names))
    assert all(name.startswith("pbd_warp/") for name in names)
    expected = {f"pbd_warp/{p.relative_to(ROOT / 'pbd_warp')}" for p in (ROOT / "pbd_warp").rglob("*.py")}
    expected |= {f"pbd_warp/{p.relative_to(ROOT)}" for k in ("kernels", "scenes") for p in (ROOT / k).rglob("*.py")}
    expected |= {
        f"pbd_warp/accuracy/charts/{p.name}" for p in (ROOT / "pbd_warp" / "accuracy" / "charts").glob("*.csv")
    }
    for room in ("drawing", "player", "view"):
        expected |= {f"pbd_warp/{room}/page/{p.name}" for p in (ROOT / "pbd_warp" / room / "page").iterdir()}
    assert set(names) == expected | {"pbd_warp/py.typed"}


def test_an_empty_environment_gets_nothing_global_but_pbd_warp(wheel, tmp_path, monkeypatch):
    venv.create(tmp_path / "env", with_pip=True)
    python = tmp_path / "env" / "bin" / "python"
    site = next((tmp_path / "env").glob("lib/python*/site-packages"))
    before = {p.name for p in site.iterdir()}
    monkeypatch.delenv("PYTHONPATH", raising=False)  # a checkout on it would pass for what is installed
    subprocess.run([python, "-m", "pip", "install", "-q", "--no-deps", wheel], check=True)
    added = {p.name for p in site.iterdir()} - before
    assert {name for name in added if not name.endswith(".dist-info")} == {"pbd_warp"}
    # With the libraries of this environment beside it, it is the installed copy that runs.
    here = next(p for p in sys.path if p.endswith("site-packages"))
    code = f"import sys; sys.path.append({here!r}); import pbd_warp as p; print(p.__file__, p.scene_names())"
    result = subprocess.run([python, "-c", code], check=True, capture_output=True, text=True, cwd=tmp_path)
    assert str(site) in result.stdout
    assert "rope" in result.stdout
