"""Things that a car detector takes for a car, and things that hide a car: what layout may add to a street."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from datasets_synth.meshes.solids import MeshDraft
from datasets_synth.street.prop_furniture import (
    bench,
    bins,
    bush,
    container,
    crates,
    fence,
    hedge,
    kiosk,
    low_wall,
    pallets,
    person,
    planters,
    skip,
    stall,
)
from datasets_synth.street.prop_parts import Pictures
from datasets_synth.street.prop_prints import (
    banner,
    billboard,
    container_picture,
    hoarding,
    shelter,
    showroom,
)
from datasets_synth.street.prop_vehicles import (
    bicycle,
    bus,
    bus_picture,
    caravan,
    cart,
    covered_boat,
    flatbed,
    minibus,
    teardrop,
    tractor,
    trailer,
    trailer_picture,
    truck,
    truck_picture,
)
from datasets_synth.street.street import bare_trunk, bollards, lamp_post, sign_post, tree
from rescore.data.rendered_kinds import PICTURE_KINDS


def _fixture(
    make: Callable[[np.random.Generator], MeshDraft],
) -> Callable[[np.random.Generator, Pictures], MeshDraft]:
    def build(rng: np.random.Generator, pictures: Pictures) -> MeshDraft:
        return make(rng)

    return build


@dataclass(frozen=True)
class Prop:
    """A kind of thing that may be put into a scene."""

    kind: str
    build: Callable[[np.random.Generator, Pictures], MeshDraft]
    on: tuple[str, ...]
    """Roles of the strips that it may stand on."""
    hides: bool = False
    """Whether the thing is small enough to stand before a car and hide a part of the car."""

    @property
    def needs_pictures(self) -> bool:
        """Whether it shows a flat picture of a car."""
        return self.kind in PICTURE_KINDS


_WALK = ("pavement", "verge", "square")
_DRIVE = ("road", "lot")
PROPS: tuple[Prop, ...] = (
    Prop("billboard", billboard, ("pavement", "verge", "square", "lot")),
    Prop("hoarding", hoarding, ("pavement", "verge", "square", "lot")),
    Prop("truck_picture", truck_picture, _DRIVE),
    Prop("bus_picture", bus_picture, ("road",)),
    Prop("container_picture", container_picture, ("lot", "verge", "square", "road")),
    Prop("banner", banner, (*_WALK, "lot")),
    Prop("showroom", showroom, ("verge", "square")),
    Prop("trailer_picture", trailer_picture, ("lot", "road", "square", "verge")),
    Prop("truck", truck, _DRIVE),
    Prop("bus", bus, ("road",)),
    Prop("caravan", caravan, ("lot", "road", "verge", "square")),
    Prop("trailer", trailer, ("lot", "road", "square")),
    Prop("boat", covered_boat, ("lot", "road", "verge")),
    Prop("minibus", minibus, _DRIVE),
    Prop("flatbed", flatbed, _DRIVE),
    Prop("teardrop", teardrop, ("lot", "road", "verge", "square")),
    Prop("tractor", tractor, ("lot", "road", "verge")),
    Prop("bicycle", bicycle, _WALK, hides=True),
    Prop("cart", cart, ("pavement", "square")),
    Prop("skip", skip, ("lot", "road", "square", "verge")),
    Prop("bins", bins, (*_WALK, "lot"), hides=True),
    Prop("bench", bench, _WALK, hides=True),
    Prop("hedge", hedge, ("verge", "square", "pavement"), hides=True),
    Prop("bush", bush, ("verge", "square"), hides=True),
    Prop("wall", low_wall, _WALK, hides=True),
    Prop("fence", fence, _WALK, hides=True),
    Prop("crates", crates, (*_WALK, "lot"), hides=True),
    Prop("pallets", pallets, (*_WALK, "lot"), hides=True),
    Prop("shelter", shelter, ("pavement", "square")),
    Prop("kiosk", kiosk, ("pavement", "square", "verge")),
    Prop("stall", stall, ("pavement", "square")),
    Prop("container", container, ("lot", "verge", "square", "road")),
    Prop("planters", planters, ("pavement", "square"), hides=True),
    Prop("person", person, _WALK, hides=True),
    Prop("tree", _fixture(tree), _WALK, hides=True),
    Prop("trunk", _fixture(bare_trunk), _WALK, hides=True),
    Prop("lamp", _fixture(lamp_post), ("pavement", "square"), hides=True),
    Prop("sign", _fixture(sign_post), ("pavement", "verge"), hides=True),
    Prop("bollards", _fixture(bollards), ("pavement", "square"), hides=True),
)
"""Everything that layout may add to a street."""

PROP = {prop.kind: prop for prop in PROPS}
