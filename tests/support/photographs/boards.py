"""Boards that the photographer sees instead of the screen: a chessboard and a ChArUco board."""

from __future__ import annotations

import functools
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from measurement.synthetic.photographer import Scene, truth_of

Picture = NDArray[np.uint8]


Light = NDArray[np.floating]


def _board(light: Callable[[Scene, tuple[int, int], float, float], Light]) -> Callable[..., Picture]:
    """Return a photographer of one kind of board, from the light (h, w) that reaches the pixels."""

    @functools.wraps(light)
    def photograph(
        scene: Scene,
        squares: tuple[int, int] = (10, 7),
        side: float = 0.008,
        blur: float = 0.8,
        noise: float = 1.0,
        seed: int = 0,
    ) -> Picture:
        clean = light(scene, squares, side, blur)
        noisy = clean + noise * np.random.default_rng(seed).normal(size=clean.shape)
        return np.repeat(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    return photograph


def _pixels(scene: Scene) -> NDArray[np.float64]:
    """Return all pixels (h w, 2) of a scene's photograph, row by row."""
    y, x = np.indices((scene.height, scene.width)).astype(float)
    return np.column_stack([x.ravel(), y.ravel()])


@_board
def chessboard(scene: Scene, squares: tuple[int, int], side: float, blur: float) -> Light:
    """Return a photograph (h, w, 3) of a chessboard about (0, 0).

    The edges are error functions of the distance in pixels: sampling a drawing, even at 16 places in a pixel, moves the
    corners by some hundredths of a pixel, which is more than they are measured to.
    """
    truth, px = truth_of(scene), _pixels(scene)
    place = truth.to_screen(px) / side
    beside = [truth.to_screen(px + step) / side - place for step in np.eye(2)]
    waves, inside = [], np.ones(len(px))
    for axis in (0, 1):
        at = place[:, axis] + squares[axis] / 2
        width = np.hypot(beside[0][:, axis], beside[1][:, axis]) * np.hypot(blur, 12**-0.5) * np.sqrt(2)
        line = np.rint(at)
        waves.append(erf((at - line) / width) * (1 - 2 * (line % 2)))
        inside = inside * 0.5 * (erf(at / width) - erf((at - squares[axis]) / width))
    light = 220.0 - inside * 90.0 * (1.0 + waves[0] * waves[1])
    return np.asarray(light.reshape(scene.height, scene.width))


@_board
def charuco(scene: Scene, squares: tuple[int, int], side: float, blur: float) -> Light:
    """Return a photograph (h, w, 3) of a ChArUco board about (0, 0)."""
    fine = 120
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    sheet = cv2.aruco.CharucoBoard(squares, 1.0, 0.75, markers).generateImage((squares[0] * fine, squares[1] * fine))
    sheet = cv2.copyMakeBorder(
        cv2.GaussianBlur(sheet, (0, 0), 1.5), fine, fine, fine, fine, cv2.BORDER_CONSTANT, value=[255]
    )
    place = truth_of(scene).to_screen(_pixels(scene)) / side * [1, -1] + np.array(squares) / 2 + 1
    at = (place * fine - 0.5).reshape(scene.height, scene.width, 2).astype(np.float32)
    light = cv2.remap(sheet, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) * 0.75 + 20.0
    return np.asarray(cv2.GaussianBlur(light, (0, 0), blur))
