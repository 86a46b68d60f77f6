"""What the example scenes of cloth are made of: fabrics and cloths as text."""

from dataclasses import replace

import numpy as np

from tools.usda import block, listed, number, said
from wsim.scene.fabric import FABRICS, Fabric, bend_of_fibres, isotropic_fabric

SOFT = '["PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI", "PhysicsCollisionAPI", "WsimClothAPI", ' \
       '"MaterialBindingAPI"]'


# A polyester sailcloth of 170 g/m^2 and 0.25 mm, finished with resin: bend = E t t^2 / 12 of E t = 200 kN/m (assumed). Resin
# holds its threads, so that it bends like a plate; without it fibres slide on each other, and it bends a hundred times as much.
SAILCLOTH = Fabric(stretch=5.0e3, shear=1.0e3, bend=1.0e-3, thickness=2.5e-4, density=170.0e-3 / 2.5e-4)
# Bounds of how these bend, from before they were compared with drape coefficients: free fibres, and a plate.
BOUNDS = {"cotton": bend_of_fibres(0.220, 5.0e6, 14.0e-6), "leather": isotropic_fabric(16.5e6 / 0.55, 0.30, 0.8e-3, 900.0).bend}
USED = {name: replace(f, bend=BOUNDS.get(name, f.bend)) for name, f in {**FABRICS, "sailcloth": SAILCLOTH}.items()}


def material(name: str, metres: float = 1.0, comment: str = "", **more) -> str:
    """The Material of a fabric; `more` goes to it. The stretch of the proposal is E h / (1 - nu^2)."""
    f = USED[name]
    values = said("Fabric", metres, stretch=f.stretch / (1.0 - f.poisson ** 2), shear=f.shear, bend=f.bend,
                  poisson=f.poisson, density=f.density, static_friction=f.static_friction,
                  dynamic_friction=f.dynamic_friction, **more)
    return block("Material", name.capitalize(), values,
                 '["PhysicsMaterialAPI", "PhysicsSurfaceDeformableMaterialAPI", "WsimMaterialAPI"]',
                 comment or f"The preset \"{name}\" of wsim.scene.fabric, where the sources of its figures are, without its "
                 "drag of the air" + {"cotton": ", bending as free fibres.", "leather": ", bending as a plate."}.get(name, "."))


def cloth(name: str, surface, fabric_name: str, color, comment: str, metres: float = 1.0, **own) -> str:
    """A cloth: body, simulation mesh and picture in one Mesh."""
    points, counts, indices = surface
    low, high = points.min(axis=0), points.max(axis=0)
    body = "\n".join(filter(None, [
        f"float3[] extent = {listed(np.array([low, high]))}",
        f"point3f[] points = {listed(points)}",
        f"int[] faceVertexCounts = {listed(counts)}",
        f"int[] faceVertexIndices = {listed(indices)}",
        'uniform token subdivisionScheme = "none"',
        looks(fabric_name, color), said("Cloth", metres, **own),
        thickness(fabric_name, metres)]))
    return block("Mesh", name, body, SOFT, comment)


def thickness(fabric_name: str, metres: float) -> str:
    return (f"float[] physics:thicknesses = [{USED[fabric_name].thickness / metres:.6g}]\n"
            'uniform token physics:thicknesses:elementType = "constant"')


def looks(material_name: str, color) -> str:
    return (f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]\n"
            f"rel material:binding:physics = </World/{material_name.capitalize()}>")
