"""Every kernel compiles for CUDA, which needs NVRTC but neither a driver nor a GPU."""

import importlib
import pkgutil

import pytest
import warp as wp

import pbd_warp.kernels
from pbd_warp.kernels.precision import MODULES, PRECISIONS
from pbd_warp.step.program import MACHINES, load_machine

for module in pkgutil.iter_modules(pbd_warp.kernels.__path__):
    importlib.import_module(f"pbd_warp.kernels.{module.name}")
for machine in MACHINES:
    for real in PRECISIONS:
        load_machine(machine, real)


@pytest.mark.parametrize("module", MODULES)
def test_every_kernel_compiles_to_ptx(module, tmp_path):
    wp.compile_aot_module(module, arch=80, module_dir=tmp_path, use_ptx=True)
    (path,) = tmp_path.glob("*.ptx")
    text = path.read_text()
    assert ".target sm_80" in text
    kernels = wp.get_module(module).kernels
    assert kernels
    for name in kernels:
        assert f"{name}_" in text


def test_there_is_no_device_name_in_the_code():
    from pathlib import Path

    for source in [*Path(pbd_warp.kernels.__path__[0]).glob("*.py"), *Path(pbd_warp.__file__).parent.rglob("*.py")]:
        text = source.read_text()
        assert '"cpu"' not in text, source
        assert '"cuda' not in text, source
