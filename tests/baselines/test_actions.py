# SPDX-License-Identifier: MIT
import numpy as np

from bitneat.baselines.actions import action_table


def test_the_table_holds_every_combination_of_three_torques_once() -> None:
    table = action_table()
    assert table.shape == (81, 4)
    assert table.dtype == np.float32
    assert set(table.ravel().tolist()) == {-1.0, 0.0, 1.0}
    assert len({tuple(row) for row in table.tolist()}) == 81


def test_an_actions_number_is_its_torques_digits_in_base_three() -> None:
    for index, row in enumerate(action_table()):
        assert sum(int(torque + 1) * 3 ** (3 - joint) for joint, torque in enumerate(row)) == index
