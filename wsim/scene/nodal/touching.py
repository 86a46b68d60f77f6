"""Which bodies of points touch others, and how: as surfaces, by triangles, or as balls, by their points. NumPy only."""


def collides_with_surfaces(body, scene) -> bool:
    """True if a body is among the surfaces that touch each other: by its own wish (`self_collision`), because balls meet it, or
    as balls that meet surfaces or strands of rods."""
    if body.self_collision and not body.meets_as_balls:
        return True
    if not body.meets_as_balls:
        return body.has_surface and any(other.meets_as_balls for other in scene.bodies())
    surfaces = any(other.has_surface for other in scene.bodies() if not other.meets_as_balls)
    return surfaces or any(rods.self_collision for rods in scene.things("Rods"))


def bodies_that_touch_as_balls(scene) -> list:
    """Bodies whose points touch as balls: particles, clouds of points that collide, and what has no surface; none where nothing
    would touch."""
    balls = [body for body in scene.bodies() if body.meets_as_balls]
    others = [body for body in scene.bodies() if not (body.meets_as_balls or body.has_surface)]
    touch = any(b.collides_as_grains for b in balls) or others or len(balls) > 1 and not all(b.is_fluid for b in balls)
    return [body for body in scene.bodies() if body in balls or body in others] if balls and touch else []


def has_self_collision(scene) -> bool:
    """True if surfaces touch themselves, each other or balls."""
    return any(collides_with_surfaces(body, scene) for body in scene.bodies())
