"""What `wsim new` makes, by its options: a scene of a mesh, or one of its own. Heavy modules are imported when needed."""

import os

from wsim.cli.new_options import STARTERS
from wsim.scene import Problem, SceneError
from wsim.simulation import interrupt


def author_new_scene(args) -> list:
    """Writes the scene; returns its notes. Raises SceneError where a file stands in the way, or the mesh does not serve."""
    if os.path.lexists(args.output) and not args.force:
        raise SceneError(Problem(args.output, "is there already; give --force to replace it, or choose another name"))
    if args.kind == "hair" and args.mesh:
        return _author_hair_scene(args)
    if args.kind in STARTERS:
        return write_starter(args)
    if args.kind == "robot":
        return _author_robot_scene(args)
    notes: list = []
    convert_meshes(args, notes)
    return notes + {"cloth": _author_cloth_scene, "softbody": _author_softbody_scene, "fluid": _author_fluid_scene,
                    "liquid": _author_fluid_scene}[args.kind](args, {
        "ground": args.ground, "meters_per_unit": args.meters_per_unit, "frames": args.frames, "pins": tuple(args.pin),
        "colliders": tuple(args.collider), "bound": args.material})


def convert_meshes(args, notes: list) -> None:
    """Puts USD files in the place of OBJ files among the arguments."""
    from wsim.usd.new.obj_file import convert_obj, is_obj

    def converted(file: str) -> str:
        return convert_obj(file, args.output, args.meters_per_unit, args.force, notes) if is_obj(file) else file
    args.mesh, args.collider = converted(args.mesh), [converted(file) for file in args.collider]


def write_starter(args) -> list:
    """A small scene of its own; returns its notes. Raises SceneError for options of hair on a mesh, without one."""
    alone = [name for name in ("prim", "where", "strands", "length", "meters_per_unit", "collider", "ground")
             if getattr(args, name, None) not in (None, [])]
    if alone:
        option = f"--{alone[0].replace('_', '-')}"
        raise SceneError(Problem(option, "is of hair on a mesh, and none is given; fix: give --on MESH, or leave it out"))
    from wsim.usd.new.starters import author_starter

    interrupt.set_interrupt_mode("wait")
    return author_starter(args.kind, args.output, args.frames)


def _author_hair_scene(args) -> list:
    """Hair on a mesh; returns its notes."""
    from wsim.usd.new.hair import author_hair

    notes: list = []
    convert_meshes(args, notes)
    interrupt.set_interrupt_mode("wait")
    given = {"strands": args.strands} if args.strands else {}
    return notes + author_hair(args.mesh, args.output, args.prim, length=args.length, where=args.where, ground=args.ground,
                               meters_per_unit=args.meters_per_unit, frames=args.frames, colliders=tuple(args.collider),
                               **given)


def _author_cloth_scene(args, more: dict) -> list:
    from wsim.usd.new.cloth import author_cloth

    interrupt.set_interrupt_mode("wait")
    return author_cloth(args.mesh, args.output, args.fabric, args.prim, weld=args.weld,
                        self_collision=args.self_collision, **more)


def _author_robot_scene(args) -> list:
    from wsim.usd.new.robot import author_robot

    interrupt.set_interrupt_mode("wait")
    return author_robot(args.file, args.output, ground=args.ground, frames=args.frames)


def _author_softbody_scene(args, more: dict) -> list:
    from wsim.scene.solid import Bulk
    from wsim.usd.new.softbody import author_softbody

    given = {name: getattr(args, name) for name in ("young", "poisson", "density", "model") if getattr(args, name) is not None}
    try:
        material = Bulk(**given) if given else None
    except ValueError as error:
        raise SceneError(Problem("material", str(error))) from None
    interrupt.set_interrupt_mode("wait")
    return author_softbody(args.mesh, args.output, material, args.prim, cells=args.cells, **more)


def _author_fluid_scene(args, more: dict) -> list:
    from wsim.usd.new.fluid import author_fluid, author_liquid

    interrupt.set_interrupt_mode("wait")
    author = {"fluid": author_fluid, "liquid": author_liquid}[args.kind]
    return author(args.mesh, args.output, args.prim, cells=args.cells, **more)
