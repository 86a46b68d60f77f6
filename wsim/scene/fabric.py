"""Cloth material: what a thin sheet is made of, in SI units, validated when made.

Energy of a deformed sheet, per rest area (plane stress; e_u, e_v stretches, g shear of warp and weft):

    psi = 1/2 stretch/(1 - nu^2) (e_u^2 + e_v^2 + 2 nu e_u e_v) + 1/2 shear g^2 + 1/2 bend |S|^2

and with a weft of its own, psi = 1/2 (stretch e_u^2 + weft e_v^2 + 2 nu sqrt(stretch weft) e_u e_v)/(1 - nu^2) + ...

so `stretch` = E t is the stiffness of a strip, force per width and strain [N/m], `shear` = G t [N/m],
`bend` = E t^3 / (12 (1 - nu^2)) [N m] for a homogeneous sheet of thickness t. S is its curvature (2 x 2; kappa^2 where it is
rolled up one way), and has no Poisson's ratio of its own: see `wsim.physics.cloth.bending`.
"""

from dataclasses import dataclass, replace
from math import inf, pi

from wsim.scene.values.table import validate_material_numbers


@dataclass(frozen=True)
class Fabric:
    """Parameters of a sheet, as in `Fabric(stretch=500.0, density=150.0)`. Raises ValueError naming the parameter, what was
    found and what is allowed.

    stretch             in-plane stiffness E t, force per width and strain [N/m], > 0
    shear               shear stiffness G t [N/m], >= 0
    bend                bending stiffness [N m], >= 0
    thickness           [m], > 0; half of it is kept from colliders on each side
    density             [kg/m^3], > 0; density * thickness is the mass per area
    poisson             Poisson's ratio [1], in (-1, 0.5)
    damping             relaxation time of the elastic forces [s]: damping force = damping * stiffness * rate
    weft                `stretch` across the warp (x of the rest shape), of membranes [N/m]; 0: as along it
    strain_limit        edges stretch to at most 1 + strain_limit times their rest length [1]; inf: no limit
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    normal_drag         drag of the air on motion along the normal, by area and speed [kg/(m^2 s)], >= 0. It counts for a
                        `Cloth` whose own `drag` is None: a number there, 0 too, replaces it

    `wsim.fabric("denim")` has measured ones: silk, cotton, denim, leather, rubber.
    """

    stretch: float = 1.0e3
    shear: float = 3.0e2
    bend: float = 1.0e-5
    thickness: float = 1.0e-3
    density: float = 200.0
    poisson: float = 0.0
    damping: float = 0.0
    weft: float = 0.0
    strain_limit: float = inf
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    normal_drag: float = 0.0

    def __post_init__(self):
        validate_material_numbers("Cloth", self)


def isotropic_fabric(youngs: float, poisson: float, thickness: float, density: float, **more) -> Fabric:
    """Homogeneous sheet of Young's modulus [Pa], Poisson ratio, thickness [m], density [kg/m^3] (E t, G t, plate
    stiffness; Timoshenko, Woinowsky-Krieger 1959, eq. 3). `more` goes to `Fabric`."""
    return Fabric(stretch=youngs * thickness, shear=youngs * thickness / (2.0 * (1.0 + poisson)),
                  bend=youngs * thickness ** 3 / (12.0 * (1.0 - poisson ** 2)),
                  thickness=thickness, density=density, poisson=poisson, **more)


def bend_of_fibres(area_density: float, modulus: float, diameter: float) -> float:
    """Bending stiffness [N m] of a woven sheet whose round fibres slide freely on each other: its lower bound.

    One of the two yarn systems, area_density / 2 [kg/m^2], bends; a fibre of section A has I = A d^2 / 16, so
    B = (area_density / 2) (E / rho) d^2 / 16 with E / rho the specific modulus [m^2/s^2] = 1e6 times the N/tex of
    textile tables, d the fibre's diameter [m]. (Hearle, Grosberg, Backer 1969; crimp neglected.)
    """
    return 0.5 * area_density * modulus * diameter ** 2 / 16.0


def _woven_fabric(area_density: float, thickness: float, warp: float, weft: float, *, slowed: float, **more) -> Fabric:
    """Woven sheet of area density [kg/m^2]; the one stretch of an isotropic sheet is the mean of warp and weft [N/m].
    Poisson ratio 0: the coupling measured beside those moduli is under 3 % of them. slowed: see below [1/s]."""
    return Fabric(stretch=0.5 * (warp + weft), thickness=thickness, density=area_density / thickness,
                  normal_drag=slowed * area_density, **more)


_GF = 9.80665e-3                                 # gram-force [N]; KES-F reports B in gf cm^2/cm, G in gf/(cm degree)
_KES_BEND = _GF * 1.0e-2                         # gf cm^2/cm to N m
_KES_SHEAR = _GF / 1.0e-2 * 180.0 / pi           # gf/(cm degree) to N/m per radian

# Sources. [W] Wang, O'Brien, Ramamoorthi 2011, "Data-driven elastic models for cloth", the measured set released with
# it: area density, and in-plane moduli c11, c22 (the two thread directions) and c33 (shear), first row, small strain
# [N/m]. [D] "Regenerated Cellulose-Based Denim Fabric for Tropical Regions", J. of Textiles 2016, 4614168, table 5:
# KES-F of six denims; means are used. [M] Morton, Hearle, "Physical Properties of Textile Fibres" (4th ed. 2008):
# specific moduli (ch. 13), friction of crossed fibres (ch. 25), fineness (ch. 3). [L] leather-dictionary.com, tensile
# strength. [G] Memon et al. 2021, Materials 14, 4553: garment leather 0.64 to 0.96 mm, drape coefficient 47 to 70 %.
# [A] Ashby, "Materials Selection in Mechanical Design" (data appendix). [R] MatWeb, "Natural Rubber, Vulcanized": G 0.5
# MPa, 950 kg/m^3.
# Friction is that of the material on itself or on a smooth solid, rounded; where no source is named it is assumed, and
# moving friction is taken 20 % lower. Nothing is said there of losses: damping is 0 and is the author's choice.
# Drag of the air. Motion along the normal dies out at the rate c / m = normal_drag / area density [1/s] (`slowed`), whatever
# its speed; the amplitude of a swing decays at half of that. c is chosen, not measured, so that a hanging cloth of 0.3 to 2 m
# settles within 2 to 6 s (tests/physics/cloth/test_settling.py). For comparison: a plate (drag coefficient 1.2) that swings at
# a peak speed V loses as much in a period as by c = 8 / (3 pi) 1/2 rho 1.2 V, which is 0.6 V kg/(m^2 s). Real cloth also loses
# energy by friction between threads; c stands for that too.
FABRICS: dict[str, Fabric] = {
    # 16 momme (1 momme = 4.34 g/m^2): a blouse. No silk is in [W]: in-plane figures are those of its lightest filament
    # weave (white-dots-on-blk, polyester, 0.128 kg/m^2). Bending by fibres of 7.3 N/tex and 12 um, friction 0.26 [M];
    # thickness from 1340 kg/m^3 fibres that fill 40 % of the cloth (assumed).
    "silk": _woven_fabric(16 * 4.34e-3, 16 * 4.34e-3 / (0.40 * 1340.0), 2002.1, 2027.5, shear=19.2,
                          bend=bend_of_fibres(16 * 4.34e-3, 7.3e6, 12.0e-6), static_friction=0.26, dynamic_friction=0.21,
                          slowed=2.2),
    # Trouser weight, 65 % cotton (royal-target in [W]). Bending: the geometric mean of its two bounds, 6.7 uN m of free
    # fibres (5.0 N/tex (Upland), 14 um [M]) and 30 uN m that [W] measured at the least curvature (a quarter of their
    # hinge coefficient, mean of three directions), in which threads hold each other. Friction 0.29 to 0.57 [M];
    # thickness from 1520 kg/m^3 fibres that fill 30 % of the cloth (assumed).
    "cotton": _woven_fabric(0.220, 0.220 / (0.30 * 1520.0), 2016.6, 2035.0, shear=104.8,
                            bend=(bend_of_fibres(0.220, 5.0e6, 14.0e-6) * 29.9e-6)**0.5, static_friction=0.45,
                            dynamic_friction=0.36, slowed=2.3),
    # 11 oz, 99 % cotton (11oz-black-denim in [W]). From [D]: bending 0.174 gf cm^2/cm (0.144 to 0.227), shear
    # 1.96 gf/(cm degree) (1.5 to 3.4), thickness 0.99 mm (0.80 to 1.19). In [W] it bends with 16 to 24 uN m, here with 17.
    "denim": _woven_fabric(0.324, 0.99e-3, 205.4, 1013.9, shear=1.96 * _KES_SHEAR, bend=0.174 * _KES_BEND,
                           static_friction=0.55, dynamic_friction=0.44, slowed=2.8),
    # Garment leather, 0.8 mm [G], 900 kg/m^3 (810 to 1050 [A]). E is the secant to failure: 8 to 25 MPa [L], mean 16.5,
    # over 0.55 elongation (0.4 to 0.7, assumed); [A] has 100 to 500 MPa for harder leathers. nu 0.3 is assumed. It bends far
    # more easily than a plate of that E (1.4 mN m, a drape coefficient of 99 %): its layers slide and its first strain is soft.
    # Bending is that of a bending length of 1.8 cm, which drapes as [G] measured.
    "leather": replace(isotropic_fabric(16.5e6 / 0.55, 0.30, 0.8e-3, 900.0, static_friction=0.6, dynamic_friction=0.48,
                                        normal_drag=2.0 * 0.8e-3 * 900.0), bend=0.8e-3 * 900.0 * 9.81 * 0.018**3),
    # 1 mm sheet: E = 2 (1 + nu) G with G and density from [R]; nu 0.499 [A], here 0.49.
    "rubber": isotropic_fabric(2.0 * 1.49 * 0.5e6, 0.49, 1.0e-3, 950.0, static_friction=1.0, dynamic_friction=0.8,
                               normal_drag=2.4 * 1.0e-3 * 950.0),
}


def fabric(name: str) -> Fabric:
    """The preset of that name (any case), as in `fabric("denim")`. Raises ValueError listing the allowed names."""
    if str(name).lower() not in FABRICS:
        raise ValueError(f"no fabric {name!r}; allowed is one of {', '.join(FABRICS)}")
    return FABRICS[str(name).lower()]
