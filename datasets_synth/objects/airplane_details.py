"""Pieces of airplanes: wings and tails, engines, propellers, landing gear, windows."""

from dataclasses import dataclass

import numpy as np

from datasets_synth.meshes.lofts import circle, loft, tube, xyz
from datasets_synth.meshes.materials import plain
from datasets_synth.meshes.mesh import Material
from datasets_synth.meshes.solids import MeshDraft
from recon.arrays import FloatArray

_GLASS = plain((0.015, 0.018, 0.022), 0.5, 0.15)
_RUBBER = plain((0.02, 0.02, 0.021), 0.02)
_STEEL = plain((0.35, 0.36, 0.37), 0.4, 0.12)
_DARK = plain((0.02, 0.02, 0.022), 0.1)


@dataclass(frozen=True, eq=False)
class Airfoil:
    """A tapered surface between two sections that lie along x."""

    root_m: FloatArray
    """Leading edge at the root, shape (3,)."""
    tip_m: FloatArray
    """Leading edge at the tip, shape (3,)."""
    root_chord_m: float
    tip_chord_m: float
    thickness: float
    """Thickness of the section in chords."""

    def at(self, share: float) -> tuple[FloatArray, float]:
        """Leading edge (3,) and chord at a share of the way from root to tip."""
        edge = self.root_m + share * (self.tip_m - self.root_m)
        return edge, self.root_chord_m + share * (self.tip_chord_m - self.root_chord_m)


def lifting_surface(draft: MeshDraft, airfoil: Airfoil, skin: Material, side: int) -> None:
    """Add a wing, half a tailplane or a fin; side -1 puts it on the other side of y = 0."""
    u = (1 - np.cos(np.linspace(0, np.pi, 9))) / 2
    half = (
        5
        * airfoil.thickness
        * (0.2969 * np.sqrt(u) - 0.126 * u - 0.3516 * u**2 + 0.2843 * u**3 - 0.1036 * u**4)
    )
    section = np.concatenate([np.stack([u, half], 1), np.stack([u[-2:0:-1], -half[-2:0:-1]], 1)])
    along = airfoil.tip_m - airfoil.root_m
    across = np.cross(along, [1.0, 0, 0])
    across /= np.linalg.norm(across)
    rings = []
    for share, slim in ((0.0, 1.0), (0.5, 1.0), (0.985, 1.0), (1.0, 0.55)):  # the tip is rounded off
        edge, chord = airfoil.at(share)
        shift = (1 - slim) * 0.4 * chord
        rings.append(
            edge
            + xyz(-shift, 0, 0)
            + section[:, :1] * chord * slim * [-1.0, 0, 0]
            + section[:, 1:] * chord * slim * across
        )
    loft(draft, np.stack(rings) * [1.0, side, 1.0], skin)


def engine(
    draft: MeshDraft,
    front_m: FloatArray,
    radius_m: float,
    length_m: float,
    skin: Material,
    *,
    pointed: bool = False,
) -> None:
    """Add a nacelle along x from the middle of its mouth; a pointed one has no mouth but a spinner's seat."""
    if pointed:
        profile = np.array([(0, 0.45), (0.06, 0.75), (0.2, 1.0), (0.55, 1.0), (0.8, 0.7), (1.0, 0.12)])
    else:  # the mouth turns inwards
        profile = np.array(
            [
                (0.10, 0.74),
                (0.02, 0.80),
                (0.0, 0.88),
                (0.04, 0.97),
                (0.2, 1.02),
                (0.45, 1.0),
                (0.75, 0.82),
                (1.0, 0.55),
            ]
        )
    ring = circle((0, 0, 0), radius_m, "x", 24)
    rings = ring[None] * profile[:, 1, None, None]
    rings[:, :, 0] = -profile[:, :1] * length_m
    loft(draft, front_m + rings, skin)
    if not pointed:
        fan = front_m + xyz(-0.095 * length_m, 0, 0)
        tube(draft, [fan, fan + xyz(-0.01 * length_m, 0, 0)], 0.74 * radius_m, _DARK, sides=24)
        cone = np.array([[0.0, 0, 0], [0.03, 0, 0], [0.055, 0, 0]]) * length_m
        tube(draft, fan + cone, np.array([0.24, 0.16, 0.01]) * radius_m, _STEEL, sides=12)
        tail = front_m + xyz(-0.99 * length_m, 0, 0)
        end = tail - xyz(0.16 * length_m, 0, 0)
        tube(draft, [tail, end], np.array([0.36, 0.05]) * radius_m, _STEEL, sides=12)


def propeller(draft: MeshDraft, hub_m: FloatArray, radius_m: float, blades: int, spinner: Material) -> None:
    """Add a propeller that faces +x, with its spinner."""
    x = np.array([-0.10, 0.0, 0.10, 0.16, 0.18]) * radius_m
    path = hub_m + x[:, None] * [1.0, 0, 0]
    tube(draft, path, np.array([0.12, 0.12, 0.09, 0.04, 0.005]) * radius_m, spinner, sides=14)
    ring = circle((0, 0, 0), 1.0, "z", 10) * [0.35, 1.0, 0.0]
    for k in range(blades):
        angle = 2 * np.pi * (k + 0.2) / blades
        out = np.array([0, np.cos(angle), np.sin(angle)])
        side = np.array([0, -np.sin(angle), np.cos(angle)])
        rings = []
        for share, width in ((0.05, 0.035), (0.35, 0.062), (0.7, 0.058), (0.95, 0.04), (1.0, 0.012)):
            twist = 1.0 - 0.75 * share  # flat near the tip
            e1 = np.cos(twist) * side + np.sin(twist) * np.array([1.0, 0, 0])
            e2 = np.cross(out, e1)
            flat = ring[:, 1:2] * e1 + ring[:, :1] * 0.35 * e2
            rings.append(hub_m + share * radius_m * out + width * radius_m * flat)
        loft(draft, np.stack(rings), _DARK)


def gear_leg(draft: MeshDraft, top_m: FloatArray, foot_m: FloatArray, radius_m: float, *, twin: bool) -> None:
    """Add a strut with one or two wheels that stand on the ground at the foot."""
    axle = foot_m + xyz(0, 0, radius_m)
    tube(draft, [top_m, axle], radius_m * 0.22, _STEEL, sides=10)
    width = 0.6 * radius_m
    for y in (-0.62 * radius_m, 0.62 * radius_m) if twin else (0.0,):
        draft.wheel(axle + xyz(0, y, 0), radius_m, width, _RUBBER, _STEEL)


def window_row(draft: MeshDraft, profile_m: FloatArray, style: str, accent: Material) -> None:
    """Add windows of the cabin and of the cockpit, and a stripe, on the skin of the fuselage.

    Args:
        draft: What they are added to.
        profile_m: Station, radius and height of the middle of sections, shape (n, 3).
        style: Of the airplane.
        accent: Of the stripe.
    """
    length = float(profile_m[-1, 0])
    tall = 1.12 if style == "light" else 1.0

    def patch(
        start: float, stop: float, low_rad: float, high_rad: float, skin: Material, lift: float
    ) -> None:
        """A patch of the skin on both sides between two stations and two angles above the horizon."""
        x = np.linspace(start, stop, max(2, int((stop - start) / length * 60) + 2))
        r = np.interp(x, profile_m[:, 0], profile_m[:, 1]) * lift
        z = np.interp(x, profile_m[:, 0], profile_m[:, 2])
        for side in (1, -1):
            for angles in zip(
                np.linspace(low_rad, high_rad, 5)[:-1], np.linspace(low_rad, high_rad, 5)[1:], strict=True
            ):
                rows = [
                    np.stack([-x, side * r * np.cos(a), (z + r * np.sin(a)) * tall], axis=1) for a in angles
                ]
                for i in range(len(x) - 1):
                    corners = np.array([rows[0][i + 1], rows[0][i], rows[1][i], rows[1][i + 1]])
                    draft.panel(corners if side < 0 else corners[[1, 0, 3, 2]], skin)

    if style == "light":
        patch(0.205 * length, 0.265 * length, 0.35, 1.57, _GLASS, 1.012)
        patch(0.28 * length, 0.35 * length, 0.25, 0.9, _GLASS, 1.012)
        patch(0.36 * length, 0.44 * length, 0.25, 0.9, _GLASS, 1.012)
        patch(0.03 * length, 0.9 * length, -0.3, -0.1, accent, 1.01)
        return
    patch(0.035 * length, 0.052 * length, 0.45, 1.57, _GLASS, 1.015)
    patch(0.12 * length, 0.8 * length, -0.12, 0.02, accent, 1.004)
    count, size = {"airliner": (44, 0.0050), "turboprop": (22, 0.0075), "business_jet": (7, 0.0150)}[style]
    for station in np.linspace(0.15, 0.72, count) * length:
        patch(station, station + size * length, 0.16, 0.34, _GLASS, 1.006)
