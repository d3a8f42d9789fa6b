"""The Cornell box of Cornell's Program of Computer Graphics in Mitsuba 3, purely Lambertian.

Prints the mean radiance of each quarter of the picture as linear RGB, with its standard error over independent runs, to hold the
scene `cornell_diffuse` of `tests/src/oracle/scenes.rs` against. Geometry and reflectances are the published ones; units are
hundredths of a published unit, x to the right and z towards the viewer. Needs the Python package `mitsuba`, nothing else:

    python tests/mitsuba/cornell.py [--size 96] [--samples 1024] [--runs 8] [--scatterings 6]
"""

import argparse

import numpy
import mitsuba

mitsuba.set_variant("scalar_rgb")

WHITE = [0.73, 0.73, 0.73]
RED = [0.63, 0.065, 0.05]
GREEN = [0.14, 0.45, 0.091]
LAMP = [34.0, 24.0, 8.0]
HEIGHT = 548.8
# The lamp hangs below the ceiling, and what shines a little below its shape.
LAMP_SHAPE = HEIGHT - 0.5
LAMP_LIGHT = LAMP_SHAPE - 0.2


def point(p):
    return [(278.0 - p[0]) * 0.01, p[1] * 0.01, -p[2] * 0.01]


def mesh(name, quads, bsdf, radiance=None):
    """Quads, counter-clockwise from the front, as one mesh of triangles."""
    extra = mitsuba.Properties()
    extra["bsdf"] = mitsuba.load_dict(bsdf)
    if radiance is not None:
        extra["emitter"] = mitsuba.load_dict({"type": "area", "radiance": {"type": "rgb", "value": radiance}})
    made = mitsuba.Mesh(name, 4 * len(quads), 2 * len(quads), props=extra)
    parameters = mitsuba.traverse(made)
    positions = [x for quad in quads for corner in quad for x in point(corner)]
    faces = [4 * q + i for q in range(len(quads)) for i in (0, 1, 2, 0, 2, 3)]
    parameters["vertex_positions"] = positions
    parameters["faces"] = faces
    parameters.update()
    return made


def diffuse(reflectance):
    value = list(reflectance)
    # Walls are seen from both sides, as in Magpie.
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}}}


def block(top, height):
    def at(i, y):
        return [top[i % 4][0], y, top[i % 4][1]]

    faces = [[at(0, height), at(1, height), at(2, height), at(3, height)]]
    faces.append([at(3, 0.0), at(2, 0.0), at(1, 0.0), at(0, 0.0)])
    faces += [[at(i, height), at(i, 0.0), at(i + 1, 0.0), at(i + 1, height)] for i in range(4)]
    return faces


def lamp(y):
    return [[[343.0, y, 227.0], [343.0, y, 332.0], [213.0, y, 332.0], [213.0, y, 227.0]]]


def scene(size, scatterings):
    h = HEIGHT
    floor = [[552.8, 0, 0], [0, 0, 0], [0, 0, 559.2], [549.6, 0, 559.2]]
    ceiling = [[556, h, 0], [556, h, 559.2], [0, h, 559.2], [0, h, 0]]
    back = [[549.6, 0, 559.2], [0, 0, 559.2], [0, h, 559.2], [556, h, 559.2]]
    right = [[0, 0, 559.2], [0, 0, 0], [0, h, 0], [0, h, 559.2]]
    left = [[552.8, 0, 0], [549.6, 0, 559.2], [556, h, 559.2], [556, h, 0]]
    short = block([[130, 65], [82, 225], [240, 272], [290, 114]], 165)
    tall = block([[423, 247], [265, 296], [314, 456], [472, 406]], 330)
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}}
    look = mitsuba.ScalarTransform4f().look_at(origin=[0, 2.73, 8], target=[0, 2.73, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    return mitsuba.load_dict(
        {
            "type": "scene",
            # Its depth counts edges from the lamp to the eye: one more than scatterings.
            "integrator": {"type": "path", "max_depth": scatterings + 1, "rr_depth": 1000},
            "sensor": {"type": "perspective", "fov": 39.3, "fov_axis": "y", "to_world": look, "film": film},
            "white": mesh("white", [floor, ceiling, back] + short + tall, diffuse(WHITE)),
            "green": mesh("green", [right], diffuse(GREEN)),
            "red": mesh("red", [left], diffuse(RED)),
            "shade": mesh("shade", lamp(LAMP_SHAPE), {"type": "twosided", "bsdf": black}),
            "lamp": mesh("lamp", lamp(LAMP_LIGHT), black, LAMP),
        }
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--size", type=int, default=96, help="pixels from side to side, even")
    arguments.add_argument("--samples", type=int, default=1024, help="samples per pixel and run")
    arguments.add_argument("--runs", type=int, default=8, help="independent runs, at least 2")
    arguments.add_argument("--scatterings", type=int, default=6, help="greatest number of scatterings of a path")
    given = arguments.parse_args()
    box = scene(given.size, given.scatterings)
    half = given.size // 2
    runs = []
    for seed in range(given.runs):
        picture = numpy.array(mitsuba.render(box, spp=given.samples, seed=seed), dtype=numpy.float64)
        rows = [picture[:half], picture[half:]]
        runs.append([part.mean(axis=(0, 1)) for row in rows for part in (row[:, :half], row[:, half:])])
    runs = numpy.array(runs)
    means, errors = runs.mean(axis=0), runs.std(axis=0, ddof=1) / len(runs) ** 0.5
    for name, mean, error in zip(("upper left", "upper right", "lower left", "lower right"), means, errors):
        print(f"{name}: {mean[0]:.5f} {mean[1]:.5f} {mean[2]:.5f} (± {error[0]:.5f} {error[1]:.5f} {error[2]:.5f})")


if __name__ == "__main__":
    main()
