"""The commands for one's own data: import, convert, doctor."""

# ruff: noqa: PLC0415 - imports inside commands keep `--help` quick; options are parameters to typer

from pathlib import Path
from typing import Annotated

import typer

from rescore.commands.base import (
    DETECTION_FORMS,
    AsJson,
    Dataset,
    Maps,
    app,
    detections_of,
    file_target,
    folder_target,
    imported_data,
    print_json,
    read_data,
)
from rescore.speech import counted, say, shown


def _boxes_target(out: Path) -> Path | None:
    return file_target(out) if out.suffix == ".json" else folder_target(out)


ClassName = Annotated[str, typer.Option("--class", help="Class whose boxes count.")]
ROS_PANEL = "Recordings of ROS 2 (a bag folder or MCAP)"
LeftTopic = Annotated[
    str | None,
    typer.Option(
        "--left", help="Topic of left pictures; not needed with one pair.", rich_help_panel=ROS_PANEL
    ),
]
RightTopic = Annotated[
    str | None, typer.Option("--right", help="Topic of right pictures.", rich_help_panel=ROS_PANEL)
]
BoxesTopic = Annotated[
    str | None,
    typer.Option(
        "--detections", help="Topic of boxes; not needed where there is one.", rich_help_panel=ROS_PANEL
    ),
]


@app.command(name="import")
def import_dataset(
    dataset: Annotated[
        Path,
        typer.Argument(help="Folder of any layout that docs/own-data.md names, or a recording of ROS 2."),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write annotations.json to.", callback=folder_target)],
    class_name: ClassName = "car",
    maps: Maps = None,
    copy: Annotated[bool, typer.Option("--copy", help="Copy the pictures too; else refer to them.")] = False,
    rectify: Annotated[
        bool, typer.Option("--rectify", help="Rectify the pictures by their calibration, and write them too.")
    ] = False,
    parts: Annotated[
        bool,
        typer.Option(
            "--parts", help="Write a table in parts in place of annotations.json, for very many frames."
        ),
    ] = False,
    left: LeftTopic = None,
    right: RightTopic = None,
    detections: BoxesTopic = None,
) -> None:
    """Write a data set of any known layout as a folder with annotations.json, to look at and to change.

    Example: [bold]rescore import kitti/training --map van=car --out data/kitti[/bold]
    """
    from recon.errors import RescoreError
    from rescore.formats.bags.topics import Wanted
    from rescore.formats.coco_write import write_dataset
    from rescore.formats.parts.frames import write_frame_parts
    from rescore.locks import locked

    topics = Wanted(left, right, detections)
    data = imported_data(dataset, class_name, maps or (), out, topics, rectify=rectify)
    if parts and copy:
        raise RescoreError(
            "import: expected --copy or --parts, got both; a table in parts refers to pictures"
        )
    with locked(out):
        if parts:
            file = write_frame_parts(out, data).root
        else:
            file = write_dataset(out, data, copy=copy and data.root != out)
    boxes = sum(len(t.annotation_id) for t in data.truth.values())
    say(f"{counted(len(data.frames), 'frame')}, {counted(boxes, 'box')}: {file}")


@app.command()
def convert(
    dataset: Dataset,
    out: Annotated[
        Path,
        typer.Option(
            help="A .json file for COCO's form, else a folder for KITTI's text.", callback=_boxes_target
        ),
    ],
    detections: Annotated[
        Path | None,
        typer.Argument(help=f"Detections to convert ({DETECTION_FORMS}); without, the annotated boxes."),
    ] = None,
    class_name: ClassName = "car",
    maps: Maps = None,
) -> None:
    """Write boxes in another form: COCO JSON, or KITTI's text, a file a frame.

    Example: [bold]rescore convert data/demo rescored.json --out kitti_results[/bold]
    """
    from recon.errors import RescoreError
    from recon.files import refuse_as_input
    from rescore.formats.coco import write_detections
    from rescore.formats.kitti import write_kitti_detections, write_kitti_labels

    as_json = out.suffix == ".json"
    if detections is None:
        if as_json:
            raise RescoreError(f"{out}: expected a folder for KITTI's labels; `rescore import` writes JSON")
        data = read_data(dataset, class_name, maps or ())
        write_kitti_labels(out, data)
        say(f"boxes of {counted(len(data.frames), 'frame')}: {out}")
        return
    refuse_as_input(out, (dataset, dataset / "annotations.json", detections))
    data = read_data(dataset, class_name)
    file = detections_of(detections, data, maps or (), every=True)
    if as_json:
        write_detections(out, file.detector, file.table, data)
    else:
        score = file.table.score if file.posterior is None else file.posterior
        write_kitti_detections(out, file.table, score, data)
    say(f"{counted(len(file.table), 'detection')} in {counted(len(data.frames), 'frame')}: {out}")


@app.command()
def doctor(
    dataset: Annotated[Path | None, typer.Argument(help="Data set to examine too.")] = None,
    class_name: ClassName = "car",
    frames: Annotated[int, typer.Option(min=1, help="Frames whose pixels are examined, evenly spread.")] = 5,
    as_json: AsJson = False,
    left: LeftTopic = None,
    right: RightTopic = None,
) -> None:
    """Examine the installation and a data set; a line a finding, exit code 1 where something is wrong.

    Example: [bold]rescore doctor my_data[/bold]
    """
    from dataclasses import asdict

    from rescore.doctor import examine_dataset, examine_installation
    from rescore.doctor.findings import Level
    from rescore.formats.bags.topics import Wanted

    findings = examine_installation()
    if dataset is not None:
        findings += examine_dataset(dataset, class_name, frames, Wanted(left, right))
    if as_json:
        print_json([asdict(finding) for finding in findings])
    for finding in () if as_json else findings:
        print(shown(str(finding)))
    wrong = sum(f.level is Level.ERROR for f in findings)
    doubtful = sum(f.level is Level.WARNING for f in findings)
    say(f"{counted(wrong, 'error')}, {counted(doubtful, 'warning')}")
    if wrong:
        raise typer.Exit(1)
