"""Exact rigid-body kinematics of a machine and its interferometer, by homogeneous 4 x 4 transforms.

Written for the blind test alone and without the project: the workflow under test must not be judged
by its own physics.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Action:
    """What acts on a run besides its harmless error curves, stop by stop.

    Attributes:
        shift: translations that the carriages of X, Y, Z make on top of their curves, m, (3, n, 3).
        turn: rotation vectors of the carriages, rad, (3, n, 3).
        scale: part by which the displacement shown is too large, (n,).
        reading: what the interferometer shows too much, m, (n,).
        mirror: rotation vectors of the mirror on its mount, rad, (n, 3).
        mount: place of the mirror on the tool, m, (n, 3); the beam is set to meet it there.
        fringe: amplitude of an error that swings with the phase of the light, m, (n,).
        fringe_period: of that, m.
    """

    shift: np.ndarray
    turn: np.ndarray
    scale: np.ndarray
    reading: np.ndarray
    mirror: np.ndarray
    mount: np.ndarray
    fringe: np.ndarray
    fringe_period: float = 1.0

    @classmethod
    def none(cls, n):
        axes, vectors = np.zeros((3, n, 3)), np.zeros((n, 3))
        return cls(
            axes, axes.copy(), np.zeros(n), np.zeros(n), vectors, vectors.copy(), np.zeros(n)
        )

    def __add__(self, other):
        return Action(
            self.shift + other.shift,
            self.turn + other.turn,
            self.scale + other.scale,
            self.reading + other.reading,
            self.mirror + other.mirror,
            self.mount + other.mount,
            self.fringe + other.fringe,
            min(self.fringe_period, other.fringe_period),
        )


def rotation_matrices(vectors):
    """Rodrigues' formula, (n, 3) → (n, 3, 3); exact for any angle."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    # np.sinc keeps both quotients right at zero.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.eye(3) + first[:, None, None] * cross + second[:, None, None] * (cross @ cross)


def carriage(axis, position, translation, rotation):
    """Transform of one carriage: its way and error translation first, then its error rotation."""
    transform = np.zeros((len(position), 4, 4))
    transform[:, :3, :3] = rotation_matrices(rotation)
    transform[:, :3, 3] = translation
    transform[:, axis, 3] += position
    transform[:, 3, 3] = 1.0
    return transform


def tool_frames(chain, position, translations, rotations):
    """Pose of the tool in the workpiece's frame, (n, 4, 4), walking from workpiece to tool."""
    pose = np.broadcast_to(np.eye(4), (len(position), 4, 4))
    for letter in chain:
        axis = "XYZ".index(letter)
        pose = pose @ carriage(axis, position[:, axis], translations[axis], rotations[axis])
    return pose


def path_lengths(pose, beam, normal, source, mount):
    """Length of the beam from its source to the mirror's plane, which turns with the tool, (n,).

    A plane does not tell where on the tool it is mounted; that the beam meets it elsewhere counts.
    """
    turned = np.einsum("nij,nj->ni", pose[:, :3, :3], normal)
    mirror = pose[:, :3, 3] + np.einsum("nij,nj->ni", pose[:, :3, :3], mount)
    along = np.sum((mirror - source - mount) * turned, axis=1)
    return along / np.sum(beam * turned, axis=1)


def displacements(chain, run, translations, action, alignment):
    """Displacement that the interferometer shows before noise and zeroing, m, (n,).

    Args:
        chain: for example YXZ.
        run: a ``blind_plans.Run``.
        translations: of the curves, (3, n, 3).
        action: of the effects.
        alignment: beam, normal, source of each stop, each (n, 3).
    """
    beam, normal, source = alignment
    pose = tool_frames(chain, run.position, translations + action.shift, action.turn)
    normal = np.einsum("nij,nj->ni", rotation_matrices(action.mirror), normal)
    length = path_lengths(pose, beam, normal, source, action.mount + run.mirror) - run.dead_path
    swing = action.fringe * np.sin(2.0 * np.pi * length / action.fringe_period)
    return length * (1.0 + action.scale) + action.reading + swing
