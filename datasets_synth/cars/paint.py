"""Materials of the cars: paint, glass, trim, lamps."""

from dataclasses import replace
from enum import IntEnum

import numpy as np

from datasets_synth.meshes.mesh import Material
from recon.arrays import FloatArray


class Finish(IntEnum):
    """Index of a material in every car's list."""

    PAINT = 0
    TRIM = 1
    GLASS = 2
    DARK = 3
    SEAM = 4
    CHROME = 5
    LAMP = 6
    BULB = 7
    TAIL_LAMP = 8
    PLATE = 9
    TYRE = 10
    RIM = 11
    CLADDING = 12
    INDICATOR = 13
    SEAL = 14


Rgb = tuple[float, float, float]

# Linear albedo and share on the road (after the paint makers' popularity reports: two thirds without colour).
_PAINTS: tuple[tuple[str, Rgb, float], ...] = (
    ("white", (0.74, 0.74, 0.72), 0.19),
    ("black", (0.010, 0.010, 0.011), 0.17),
    ("dark grey", (0.050, 0.052, 0.056), 0.15),
    ("grey", (0.16, 0.165, 0.17), 0.08),
    ("silver", (0.40, 0.41, 0.42), 0.10),
    ("dark blue", (0.012, 0.025, 0.085), 0.09),
    ("blue", (0.03, 0.11, 0.38), 0.05),
    ("red", (0.38, 0.018, 0.016), 0.06),
    ("dark red", (0.12, 0.010, 0.014), 0.03),
    ("green", (0.022, 0.070, 0.035), 0.03),
    ("beige", (0.42, 0.35, 0.25), 0.02),
    ("brown", (0.085, 0.05, 0.032), 0.015),
    ("yellow", (0.68, 0.43, 0.02), 0.01),
    ("orange", (0.55, 0.13, 0.012), 0.005),
)


def car_materials(rng: np.random.Generator) -> tuple[Material, ...]:
    """Materials of one car, in the order of `Finish`, with a random paint and random trim."""
    shares = np.array([share for _, _, share in _PAINTS])
    name, base, _ = _PAINTS[int(rng.choice(len(_PAINTS), p=shares / shares.sum()))]
    tint = rng.normal(1.0, 0.06, 3) * rng.uniform(0.8, 1.25)
    paint = tuple(float(c) for c in np.clip(np.asarray(base) * tint, 0.006, 0.85))
    dirt = float(rng.uniform(0.0, 1.0))
    glass = float(rng.uniform(0.008, 0.03))
    rim = float(rng.choice([0.50, 0.35, 0.62, 0.05], p=[0.45, 0.25, 0.18, 0.12]))
    chrome = float(rng.choice([0.55, 0.04], p=[0.6, 0.4]))
    plate: Rgb = ((0.72, 0.72, 0.70), (0.72, 0.52, 0.05))[int(rng.random() < 0.2)]

    def grey(value: float) -> Rgb:
        return (value, value, value * 1.02)

    made = {
        Finish.PAINT: Material(
            f"paint {name}",
            (paint[0], paint[1], paint[2]),
            None,
            0.30 - 0.15 * dirt,
            90.0,
            0.10 - 0.06 * dirt,
        ),
        Finish.TRIM: Material("trim", grey(0.018), None, 0.08, 20.0, 0.01),
        Finish.GLASS: Material(
            "glass", (glass, glass * 1.08, glass * 1.08), None, 0.5, 200.0, 0.20 - 0.06 * dirt
        ),
        Finish.DARK: Material("underside", grey(0.008)),
        Finish.SEAM: Material("seam", grey(0.010)),
        Finish.CHROME: Material("chrome", grey(chrome), None, 0.6, 80.0, 0.3 if chrome > 0.1 else 0.03),
        Finish.LAMP: Material("lamp", grey(0.30), None, 0.6, 120.0, 0.22),
        Finish.BULB: Material("bulb", grey(0.74), None, 0.6, 120.0, 0.22),
        Finish.TAIL_LAMP: Material("tail lamp", (0.26, 0.008, 0.010), None, 0.5, 120.0, 0.10),
        Finish.PLATE: Material("plate", plate, None, 0.05, 20.0, 0.0),
        Finish.TYRE: Material("tyre", grey(0.020 + 0.02 * dirt), None, 0.02, 8.0, 0.0),
        Finish.RIM: Material("rim", grey(rim), None, 0.5, 40.0, 0.12),
        Finish.CLADDING: Material("cladding", grey(0.022 + 0.015 * dirt), None, 0.05, 12.0, 0.0),
        Finish.INDICATOR: Material("indicator", (0.60, 0.17, 0.01), None, 0.5, 120.0, 0.10),
        Finish.SEAL: Material("window seal", grey(0.010), None, 0.06, 20.0, 0.01),
    }
    return tuple(made[finish] for finish in Finish)


def unusual_materials(rng: np.random.Generator) -> tuple[Material, ...]:
    """Materials of one car as other people's models have theirs, in the order of `Finish`.

    Lamps may have no colour or the paint's, glass any colour or none of its own, seals and seams may be
    missing: what is learned from such cars does not hang on one of them.
    """
    made = dict(zip(Finish, car_materials(rng), strict=True))
    if rng.random() < 0.4:
        rgb = rng.uniform(0.06, 0.7) * rng.dirichlet((0.7, 0.7, 0.7)) * 1.6
        made[Finish.PAINT] = replace(made[Finish.PAINT], name="paint other", rgb=_rgb(rgb))
    paint = made[Finish.PAINT]
    grey = float(rng.choice([0.012, 0.05, 0.2, 0.45]))
    glass = _rgb(grey * rng.uniform(0.6, 1.2, 3))
    if rng.random() < 0.6:
        made[Finish.GLASS] = replace(made[Finish.GLASS], rgb=glass, mirror=float(rng.uniform(0, 0.2)))
    if rng.random() < 0.08:
        made[Finish.GLASS] = paint
    # what a finish may look like besides itself, and how often it keeps its own look
    dark, lamp = made[Finish.DARK], made[Finish.LAMP]
    for finish, kept, others in (
        (Finish.TAIL_LAMP, 0.4, (paint, dark, lamp)),
        (Finish.LAMP, 0.5, (paint, dark)),
        (Finish.BULB, 0.5, (paint, dark)),
        (Finish.INDICATOR, 0.4, (paint, lamp)),
        (Finish.PLATE, 0.6, (paint, dark)),
        (Finish.SEAL, 0.3, (paint, made[Finish.GLASS])),
        (Finish.SEAM, 0.5, (paint,)),
        (Finish.TRIM, 0.5, (paint,)),
        (Finish.CLADDING, 0.5, (paint,)),
        (Finish.CHROME, 0.5, (paint, dark)),
    ):
        if rng.random() >= kept:
            made[finish] = others[int(rng.integers(len(others)))]
    return tuple(made[finish] for finish in Finish)


def _rgb(values: FloatArray) -> Rgb:
    r, g, b = (float(v) for v in np.clip(values, 0.006, 0.85))
    return (r, g, b)
