"""The rescorer that comes with the package: ``python -m reports.publishing.defaults RUN [--detector NAME]``.

Class model, evidence of mode instance, w and settings of a finished run of ``rescore reproduce``, in one file
of ``rescore/defaults``. With it `rescore apply` and ``Rescorer.default`` need no training.
"""

import argparse
import sys
from pathlib import Path

import rescore.defaults
from recon.errors import RescoreError
from rescore.evidence.registration import Registration
from rescore.library.bundles import Bundle, write_bundle
from rescore.library.rescorer_files import parts_of_run
from rescore.results.run_config_file import RunConfigFile, read_run_config
from rescore.results.run_folder import RunFolder

MOST_BYTES = 1_500_000
"""A larger file does not go into the package."""


def publish_defaults(run_dir: Path, out: Path, detector: str | None = None) -> Path:
    """Write the bundle of a run to a folder; returns its file.

    Args:
        run_dir: the run, which has mode instance.
        out: the folder.
        detector: whose evidence model and w are taken; None for the first one of the run.

    Raises:
        RescoreError: no such run, mode or detector, a class model without a shape space, or a file that is
            too large.
    """
    folder = RunFolder(run_dir)
    config = read_run_config(folder.config)
    name = detector or next(iter(config.config.detectors), "hog")
    if Registration.INSTANCE not in config.config.registrations:
        raise RescoreError(
            f"{run_dir}: expected a finished run with mode {Registration.INSTANCE}, got one without; run "
            '`rescore reproduce` with "instance" in registrations'
        )
    parts = parts_of_run(run_dir, name, Registration.INSTANCE)
    assert parts.class_model is not None
    assert parts.evidence_model is not None
    if parts.class_model.shape_space is None:
        raise RescoreError(
            f"{folder.class_model}: expected a shape space, got none; learn from more part-labelled instances"
        )
    made_with = (_reproduce(config), f"python -m reports.publishing.defaults {run_dir} --detector {name}")
    file = out / f"{parts.class_model.class_name}{rescore.defaults.SUFFIX}"
    write_bundle(file, Bundle(parts.class_model, parts.evidence_model, parts.w, parts.config, made_with))
    size = file.stat().st_size
    if size > MOST_BYTES:
        file.unlink()
        raise RescoreError(
            f"{file}: expected at most {MOST_BYTES} bytes, got {size}; learn a shape space with fewer modes"
        )
    return file


def _reproduce(config: RunConfigFile) -> str:
    """The command that made a run, but for its folder."""
    return f"rescore {config.command} --preset {config.config.preset} --seed {config.seed}"


def main(arguments: list[str]) -> int:
    """Publish the rescorer that the command line names; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m reports.publishing.defaults")
    parser.add_argument("run", type=Path, help="folder of a finished run with mode instance")
    parser.add_argument("--detector", help="whose evidence model and w are taken; else the run's first")
    chosen = parser.parse_args(arguments)
    out = Path(str(rescore.defaults.FOLDER))
    try:
        file = publish_defaults(chosen.run, out, chosen.detector)
    except RescoreError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"rescorer: {file} ({file.stat().st_size / 1e6:.2f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
