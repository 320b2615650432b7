"""The materials of the library in visible light, for the camera: at 550 nm, or as a mean from 400 to 700 nm.

Numbers at 1.5 µm are no guide to these: dyes and silicon are transparent there, and metals reflect more. Where nobody
has said what a surface reflects in visible light, that of 1.5 µm stands in; :func:`unknown_visible` says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from scanner_sim.scene.materials import Material, ggx_albedo, normal_reflectance

Band = Literal["laser", "visible"]
"""The light in which surfaces are built: the laser's, or what the eye and a video camera see."""


class Visible(NamedTuple):
    """What a material is in visible light: hemispherical reflectance, index of refraction where it has one, source."""

    reflectance: float
    source: str
    eta: float | None = None
    k: float | None = None


_ALUMINIUM = (0.963, 6.70)
_ALUMINIUM_SOURCE = "Al n 0.963, k 6.70 at 551 nm (luxpop.com's table, as in Mitsuba 3's data Al.spd)"
_NICKEL = (1.77, 3.25)
_NICKEL_SOURCE = "Ni n 1.77, k 3.25 at 549 nm (Palik, as in Mitsuba 3's data Ni_palik.spd)"

VISIBLE: Mapping[str, Visible] = MappingProxyType(
    {
        "evaporated_aluminium": Visible(0.921, _ALUMINIUM_SOURCE, *_ALUMINIUM),
        "weathered_aluminium": Visible(
            0.76,
            "assumption, 0.55 to 0.85: falls from 1.5 µm as the bare metal does; lobe: " + _ALUMINIUM_SOURCE,
            *_ALUMINIUM,
        ),
        "nickel": Visible(0.612, _NICKEL_SOURCE, *_NICKEL),
        "z93_white": Visible(0.90, "assumption, 0.86 to 0.93: most of its solar absorptance is ultraviolet"),
        "beta_cloth": Visible(0.78, "assumption, 0.65 to 0.85"),
        "aluminised_kapton": Visible(
            0.66,
            "assumption, 0.6 to 0.75: the film absorbs blue and green; lobe of the metal behind it: "
            + _ALUMINIUM_SOURCE,
            *_ALUMINIUM,
        ),
        "black_paint": Visible(0.04, "assumption, 0.03 to 0.06"),
        "dyed_black_anodise": Visible(
            0.05, "assumption, 0.03 to 0.08: the dye absorbs all that the eye sees"
        ),
        "black_oxide": Visible(0.08, "assumption, 0.05 to 0.12"),
        "oxidised_inconel": Visible(
            0.15, "assumption, 0.08 to 0.25; lobe of its main component: " + _NICKEL_SOURCE, *_NICKEL
        ),
        "solar_cell": Visible(
            0.08,
            "assumption, 0.05 to 0.12: coated silicon absorbs; lobe of the cover glass, n 1.5",
            1.5,
            0.0,
        ),
        "target_black": Visible(0.05, "assumption, 0.03 to 0.08; a parameter of the target"),
        "target_white": Visible(0.85, "assumption, 0.7 to 0.92; a parameter of the target"),
        "grey_reference": Visible(0.50, "by definition: a 50 % Lambertian reference"),
        "retro_sheet": Visible(0.5, "assumption, 0.3 to 0.7; its lobe was measured in visible light"),
        "corner_cube_array": Visible(0.65, "assumption, 0.4 to 0.8; its lobe was measured in visible light"),
    }
)
"""Every material of the library in visible light, by name."""


def is_known_in_visible_light(material: Material) -> bool:
    """Tell whether anybody has said what a material reflects in visible light."""
    return material.name in VISIBLE or material.reflectance_visible is not None


def unknown_visible(name: str) -> str:
    """Return the sentence on a material of which nobody has, by the name that results know it by."""
    return f"the reflectance of '{name}' in visible light is not known: to the camera it is that of 1.5 µm"


def in_visible_light(material: Material) -> Material:
    """Return a material as it is in visible light.

    Parameters
    ----------
    material
        Of the library, or a scenario's own with its ``reflectance_visible``.

    Returns
    -------
    Material
        Of the same name. Where nothing is known, the one of 1.5 µm. A specular lobe keeps its roughness
        and share; the share is lowered where the lobe alone would reflect more than the whole.
    """
    known = VISIBLE.get(material.name)
    if known is None:
        if material.reflectance_visible is None:
            return material
        known = Visible(material.reflectance_visible, material.source, material.eta, material.k)
    numbers = material.model_dump() | {
        "reflectance": known.reflectance,
        "reflectance_visible": known.reflectance,
        "reflectance_out_of_band": None,
        "eta": known.eta,
        "k": known.k,
        "retro": material.retro,
        "source": known.source,
    }
    if (
        material.kind == "mixed"
        and known.eta is not None
        and known.k is not None
        and material.alpha is not None
    ):
        lobe = normal_reflectance(known.eta, known.k) * ggx_albedo(material.alpha)
        numbers["specular_share"] = min(material.specular_share, known.reflectance / lobe)
    return Material.model_validate(numbers)
