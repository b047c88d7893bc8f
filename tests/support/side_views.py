"""Photographs of bars that bend, rendered by PyVista: perspective, shading, blur, noise. Their tips, angles and centre lines
are known in closed form. Shares no code with the reader of photographs."""

from __future__ import annotations

import cv2
import numpy as np
import pyvista as pv

PIXEL, FAR, DEPTH, LENGTH, THICK = 1e-4, 0.8, 0.015, 0.09, 0.012
"""Size of a pixel in the bar's middle plane, distance of the camera, depth, length and thickness of a bar, in m."""
SIZE, CENTRE = (1400, 1000), np.array([0.04, -0.03])
"""Pixels of a photograph, and the place in m at its middle."""
CLAMP = 0.02


def to_pixels(places, pixel=PIXEL, centre=CENTRE, size=SIZE):
    """Pixels (n, 2) of places (n, 2) in the middle plane."""
    return (np.asarray(places) - centre) / pixel * [1.0, -1.0] + (np.array(size) - 1.0) / 2.0


BASE = to_pixels([[0.0, THICK / 2], [0.0, -THICK / 2]])


def bent_bar(turn, length=LENGTH, twist=0.0):
    """A bar from x = 0 whose centre line is a circle's arc that turns downwards by ``turn`` rad, its clamp beside it; ``twist``
    turns it about the x axis, out of the plane. Returns surface, tip (2,), angle and dense centre line."""
    s = np.linspace(0.0, length, 400)
    bend = turn / length
    angle = -bend * s
    # Stable for a bar that is all but straight.
    line = s[:, None] * np.column_stack(
        [np.sinc(bend * s / np.pi), -np.sin(bend * s / 2) * np.sinc(bend * s / 2 / np.pi)],
    )  # fmt: skip
    normal = np.column_stack([-np.sin(angle), np.cos(angle)])
    edges = [np.vstack([[-CLAMP, side], line + side * normal]) for side in (THICK / 2, -THICK / 2)]
    points = np.vstack(
        [np.column_stack([e[:, 0], np.full(len(e), y), e[:, 1]]) for y in (-DEPTH / 2, DEPTH / 2) for e in edges]
    )
    count = len(edges[0])
    quads = [
        (a * count + i, a * count + i + 1, b * count + i + 1, b * count + i)
        for a, b in ((0, 1), (2, 3), (0, 2), (1, 3)) for i in range(count - 1)
    ]  # fmt: skip
    quads.append(tuple(k * count + count - 1 for k in (0, 1, 3, 2)))
    out = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(twist), -np.sin(twist)], [0.0, np.sin(twist), np.cos(twist)]])
    return pv.PolyData(points @ out.T, np.array([(4, *quad) for quad in quads]).ravel()), line[-1], angle[-1], line


RED = (0.75, 0.06, 0.08)


def dots(turn, places, radius=1.5e-3, colour=RED, length=LENGTH, stretch=1.0):
    """Round stickers on the front face of a bent bar, and their middles (n, 2): ``places`` (n, 2) along its centre line and
    across it."""
    angle, made, middles = np.linspace(0.0, 2.0 * np.pi, 181)[:-1], [], []
    ring = radius * np.column_stack([stretch * np.cos(angle), np.sin(angle)])
    for along, across in places:
        turned, half = -turn * along / length, turn * along / length / 2
        chord = along * np.sinc(half / np.pi)
        middle = np.array([chord * np.cos(half), -chord * np.sin(half)]) + across * np.array([-np.sin(turned), np.cos(turned)])
        c, s = np.cos(turned), np.sin(turned)
        x, z = (middle + ring @ np.array([[c, s], [-s, c]])).T
        points = np.column_stack([x, np.full(len(x), -DEPTH / 2 - 2e-5), z])
        made.append((pv.PolyData(points, np.r_[len(points), np.arange(len(points))]), colour))
        middles.append(middle)
    return made, np.array(middles)


CHAMBERS, GAP, FLOOR, PLATE = 4, 0.006, 0.003, 0.003
"""Chambers on the floor of a comb, the gaps between them, thickness of its floor and of the plate at its end, in m."""


def bent_comb(turn, height=0.018, length=0.06):
    """A floor from x = 0 with chambers on it and a plate at its end, bent like a bar by ``turn`` rad about its mid-height.
    Returns its parts, tip (2,), angle, dense centre line, and the pixels of its base."""
    wide = (length - PLATE - CHAMBERS * GAP) / CHAMBERS
    spans = [(k * (wide + GAP), k * (wide + GAP) + wide) for k in range(CHAMBERS)] + [(length - PLATE, length)]
    boxes = [(-CLAMP, 0.0, 0.0, height), (0.0, length, 0.0, FLOOR), *((*span, 0.0, height) for span in spans)]
    parts = [pv.Box((a, b, -DEPTH / 2, DEPTH / 2, c - height / 2, d - height / 2), level=40) for a, b, c, d in boxes]
    bend = turn / length

    def mapped(x, z):
        s = np.maximum(x, 0.0)
        half = bend * s / 2
        chord = s * np.sinc(half / np.pi)
        line = np.column_stack([np.minimum(x, 0.0) + chord * np.cos(half), -chord * np.sin(half)])
        return line + z[:, None] * np.column_stack([np.sin(bend * s), np.cos(bend * s)])

    for part in parts:
        x, y, z = part.points.T
        seen = mapped(x, z)
        part.points = np.column_stack([seen[:, 0], y, seen[:, 1]])
    line = mapped(np.linspace(0.0, length, 400), np.zeros(400))
    return parts, line[-1], -turn, line, to_pixels([[0.0, height / 2], [0.0, -height / 2]])


def photograph(path, *parts, seed=0, noise=1.5, **how):
    """Write a photograph of surfaces; see `rendered`."""
    store(path, rendered(*parts, **how), seed, noise)


def rendered(
    *parts, shift_px=(0.0, 0.0), colour=(0.75, 0.35, 0.3), background=(0.9, 0.92, 0.95), blur=0.8, pixel=PIXEL, centre=CENTRE,
    size=SIZE,
):  # fmt: skip
    """The light (h, w, 3) of a photograph of surfaces, or of pairs of a surface and its texture or its own colour, before a
    background."""
    width, height = size
    plotter = pv.Plotter(off_screen=True, window_size=size)
    plotter.set_background(background)
    plotter.disable_anti_aliasing()
    for part in parts:
        if isinstance(part, tuple):
            plotter.add_mesh(part[0], lighting=False, **{"color" if isinstance(part[1], tuple) else "texture": part[1]})
        else:
            plotter.add_mesh(part, color=colour, ambient=0.35, diffuse=0.6, specular=0.1)
    camera, (x, z) = plotter.camera, centre + np.array(shift_px) * pixel
    camera.position, camera.focal_point, camera.up = (x, -FAR, z), (x, 0.0, z), (0.0, 0.0, 1.0)
    camera.view_angle = float(2 * np.degrees(np.arctan(height * pixel / 2 / FAR)))
    camera.clipping_range = (0.1, 10.0)
    light = 0.0
    for k in range(9):  # nine rows and nine columns, so that an edge along the pixels is no staircase of thirds
        camera.SetWindowCenter(2 * (k - 4) / 9 / width, 2 * ((4 * k) % 9 - 4) / 9 / height)
        plotter.render()
        stored = plotter.screenshot(return_img=True).astype(float) / 255
        light = light + np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4) / 9
    plotter.close()
    return cv2.GaussianBlur(light, (0, 0), blur)


def stored(light, seed=0, noise=1.5):
    """The photograph (h, w, 3) of a light (h, w, 3) with a sensor's noise, by OpenCV's order of channels."""
    light = np.maximum(light, 0.0)
    made = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055) * 255
    made = np.clip(np.rint(made + np.random.default_rng(seed).normal(0.0, noise, made.shape)), 0, 255).astype(np.uint8)
    return made[..., ::-1]


def store(path, light, seed=0, noise=1.5, quality=93):
    """Write the photograph of a light (h, w, 3) with a sensor's noise."""
    cv2.imwrite(
        str(path), stored(light, seed, noise), [cv2.IMWRITE_JPEG_QUALITY, quality] if str(path).endswith(".jpg") else []
    )


def tag(x, z, side, behind, number=5):
    """An AprilTag with its white rim as a surface with a texture: the lower left corner of its black square, its side, and how
    far it lies behind the bar's middle plane, in m."""
    black = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), number, 800, borderBits=1
    )
    image = np.repeat(np.pad(black, 100, constant_values=255)[..., None], 3, axis=2)
    rim = side / 8
    low, high = np.array([x - rim, z - rim]), np.array([x + side + rim, z + side + rim])
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    surface = pv.PolyData(np.array([(a, behind, b) for a, b in corners]), np.array([4, 0, 1, 2, 3]))
    surface.active_texture_coordinates = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return surface, pv.Texture(image)


def revolved(meridian, turned=0.0):
    """The surface of revolution of a meridian (n, 2) of r and z in m about the z axis, which is then turned by an angle in rad
    in the plane of the picture."""
    angle = np.linspace(0.0, 2.0 * np.pi, 361)[:-1]
    r, z = np.asarray(meridian).T
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.column_stack([(r[:, None, None] * ring).reshape(-1, 2), np.repeat(z, len(angle))])
    c, s = np.cos(turned), np.sin(turned)
    points = points @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    count = len(angle)
    low = (np.arange(len(r) - 1)[:, None] * count + np.arange(count)).ravel()
    right = (np.arange(len(r) - 1)[:, None] * count + (np.arange(count) + 1) % count).ravel()
    faces = np.column_stack([np.full(len(low), 4), low, right, right + count, low + count])
    return pv.PolyData(points, faces.ravel())
