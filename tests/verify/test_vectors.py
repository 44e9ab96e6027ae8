# SPDX-License-Identifier: MIT
import numpy as np

from bitneat.controller import Controller, Input, Signal
from bitneat.verify.vectors import random_vectors


def test_vectors_stay_in_the_domain_and_reach_its_ends() -> None:
    controller = Controller((Input(0, 1), Input(0, 300), Input()), (), (Signal(0),), 8)
    limits = np.array([1, 300, 32767])
    vectors = random_vectors(controller, 0, 3000)
    assert vectors.dtype == np.int16
    assert (np.abs(vectors.astype(int)) <= limits).all()
    assert vectors[0].tolist() == limits.tolist()
    assert vectors[1].tolist() == (-limits).tolist()
    assert vectors[2].tolist() == [0, 0, 0]
    for value in (0, 1, -1, 255, 256, 257, -300, 300):
        assert value in vectors[:, 1]
    # Both ends alike.
    assert abs((vectors[:, 0] == 1).sum() - (vectors[:, 0] == -1).sum()) < 250
    # Every magnitude has its share.
    assert (np.abs(vectors[:, 2].astype(int)) < 16).sum() > 200
    assert (np.abs(vectors[:, 2].astype(int)) > 16000).sum() > 500
    # Of what stands at marks a sixth is 0, and numbers of few bits have either sign.
    assert (vectors[:, 2] == 0).sum() > 270
    for mark in (1, 255, 256, 257, 32767):
        assert (np.abs(vectors[:, 2].astype(int)) == mark).sum() > 110
    few = vectors[(np.abs(vectors[:, 2].astype(int)) < 128) & (vectors[:, 2] != 0), 2]
    assert 0.3 < (few < 0).mean() < 0.7
    assert len(set(few.tolist())) > 60


def test_vectors_are_the_same_for_the_same_seed() -> None:
    controller = Controller((Input(),), (), (Signal(0),), 8)
    assert (random_vectors(controller, 3, 50) == random_vectors(controller, 3, 50)).all()
    assert (random_vectors(controller, 3, 50) != random_vectors(controller, 4, 50)).any()
