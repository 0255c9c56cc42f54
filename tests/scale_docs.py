"""Runs the commands of docs/scale.md as they stand there: `python -m tests.scale_docs`.

A few frames are rendered first: they are MY_DATA. Then all blocks run in their order in one shell, in name
spaces of its own, so that ports are free and `ray stop` finds no other cluster; that takes root on Linux.
It ends with the first command that fails.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rescore.detectors.modelled import ModelledConfig, ModelledDetector
from rescore.detectors.platt import PlattScaling, save_scaling
from tests.conftest import ROOT

PAGE = ROOT / "docs" / "scale.md"
SPLITS = {"train": 1, "calibration": 1, "validation": 1, "test": 4}
SHELL = """set -euo pipefail
ip link set lo up
export RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER=0
"""
"""What comes before the commands: name spaces have no loopback address, Ray is told what the page says."""


def blocks() -> list[str]:
    """The blocks of commands of the page, in their order."""
    found = re.findall(r"^```\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert found, "the page has commands"
    return found


def render(root: Path) -> None:
    """Frames, a detector that needs no training and its detections, as the page takes them for given."""
    splits = {name: {"n_images": n, "n_cars": 2 * n} for name, n in SPLITS.items()}
    changes = root / "few.json"
    changes.write_text(json.dumps({"synth": {"n_pictures": 1, "splits": splits}}))
    _run(root, "synth", "MY_DATA", "--preset", "tiny", "--config", changes)
    (root / "models").mkdir()
    detector = root / "models" / "hog.npz"
    ModelledDetector(0, ModelledConfig(), "hog").save(detector)
    save_scaling(detector.with_suffix(".platt.json"), PlattScaling(-1.0, 0.0))
    _run(root, "detect", "MY_DATA", "--detector", detector, "--out", "detections.json")


def _run(root: Path, *arguments: object) -> None:
    command = [sys.executable, "-m", "rescore.cli", *map(str, arguments)]
    subprocess.run(command, check=True, cwd=root, env=os.environ | {"PYTHONPATH": str(ROOT)})


def main() -> None:
    """Render, then run all blocks."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        render(root)
        script = root / "commands.sh"
        # each command is shown before it runs
        script.write_text(SHELL + "set -x\n" + "".join(blocks()))
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        places = {"PATH": path, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(root / "cache")}
        start_s = time.monotonic()
        alone = ["unshare", "--pid", "--fork", "--mount-proc", "--net", "--kill-child"]
        done = subprocess.run([*alone, "bash", script.name], cwd=root, env=os.environ | places, check=False)
        print(f"{len(blocks())} blocks, {time.monotonic() - start_s:.0f} s, exit code {done.returncode}")
        sys.exit(done.returncode)


if __name__ == "__main__":
    main()
