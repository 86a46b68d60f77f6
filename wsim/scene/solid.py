"""Material of a soft body: what a solid is made of, in SI units, validated when made. kernels/soft/material.py has the
energies.

    corotational           Hooke's law in the turned frame: the fast default, any E and nu; loses volume at large twists
    neo_hookean            stable Neo-Hookean (Smith, de Goes, Kim 2018): keeps volume, for large strain
    st_venant_kirchhoff    Hooke's law of Green's strain, for comparison: softens under pressure, does not resist inversion
    linear                 small strain and small turns only: for comparison; a turned body swells

Each has Young's modulus E and Poisson's ratio nu at rest. Of Rayleigh's two parts of damping, force = -c M v - damping K v, the
second is the material's: of the rate of Green's strain, it leaves rigid motion alone. c is `Scene.air_drag`.

A yield strain y bounds |dev E|, the square root of the sum of the squares of the deviatoric strain: a bar that is pulled begins
to flow at the strain sqrt(3/2) y / (1 + nu), and keeps what goes beyond it (kernels/soft/plastic.py). Volume always comes back.
Nothing tears.
"""

from dataclasses import dataclass
from math import inf

from wsim.scene.values.table import validate_material_numbers

MODELS = ["corotational", "neo_hookean", "st_venant_kirchhoff", "linear"]


@dataclass(frozen=True)
class Bulk:
    """Parameters of a solid, as in `Bulk(young=2e4, poisson=0.4)`. Raises ValueError naming the parameter, what was found and
    what is allowed.

    young               Young's modulus E [Pa], > 0
    poisson             Poisson's ratio [1], in (-1, 0.5)
    density             [kg/m^3], > 0
    model               elastic model: "corotational", "neo_hookean", "st_venant_kirchhoff" or "linear"
    damping             relaxation time of the elastic forces [s]
    yield_strain        shape is lost for good where the deviatoric strain |dev E| is larger [1]; inf: elastic
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    """

    young: float = 1.0e6
    poisson: float = 0.3
    density: float = 1.0e3
    model: str = "corotational"
    damping: float = 0.0
    yield_strain: float = inf
    static_friction: float = 0.5
    dynamic_friction: float = 0.5

    def __post_init__(self):
        if self.model not in MODELS:
            raise ValueError(f"model is {self.model!r}; allowed is one of {', '.join(MODELS)}")
        validate_material_numbers("Soft", self)
