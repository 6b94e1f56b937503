"""What the scripts of the examples find."""

import pytest

from tests.test_examples import EXAMPLES, script


@pytest.fixture(scope="module")
def sweep():
    return script(EXAMPLES / "sliding_punch" / "sweep.py")


@pytest.fixture(scope="module")
def compare():
    return script(EXAMPLES / "over_constraint" / "compare.py")


def test_on_a_stiff_base_a_sliding_punch_oscillates_far_less_without_facets(sweep):
    found = sweep.main(meshes={100.0: 24}, periods=1, positions=2)[100.0]
    assert found[2] < found[1] / 10
    assert found[3] < found[1] / 100


@pytest.mark.slow
def test_on_a_base_as_stiff_as_itself_the_edge_of_contact_limits_all_degrees(sweep):
    found = sweep.main()
    assert found[100.0][2] < found[100.0][1] / 10
    assert found[100.0][3] < found[100.0][1] / 100
    assert found[1.0][1] / 10 < found[1.0][2] < found[1.0][1] / 2
    assert found[1.0][1] / 10 < found[1.0][3] < found[1.0][1] / 3


def test_segment_cells_pass_the_patch_test_with_either_method_and_element_cells_with_none(compare):
    for (_, integration, mesh), error in compare.compare_patch_tests().items():
        assert error > 1e-4 if (integration, mesh) == ("element", "non-matching") else error < 1e-10


def test_kts_locks_at_a_penalty_at_which_mortar_kts_does_not(compare):
    found = compare.compare_hertz(penalties=(1e4,))
    assert found["kts", 1e4] > 0.2
    assert found["mortar", 1e4] < 0.08


@pytest.mark.slow
def test_kts_is_the_better_one_with_a_soft_penalty_and_of_no_use_with_a_stiff_one(compare):
    found = compare.compare_hertz(penalties=(10.0, 1e6))
    assert found["kts", 10.0] < found["mortar", 10.0] < 0.08
    assert found["kts", 1e6] > 1
    assert found["mortar", 1e6] < 0.08


def check_orders_of_rings(orders):
    for degree, order in orders.items():
        assert order.displacement == pytest.approx(degree + 1, abs=0.4)
        assert order.stress == pytest.approx(degree, abs=0.4)
        assert order.pressure > degree or degree == 4  # which reaches rounding


def test_two_rings_in_contact_converge_at_the_orders_of_their_degree():
    check_orders_of_rings(script(EXAMPLES / "lame_rings" / "orders.py").main(degrees=(2, 3), spans=(4, 8)))


@pytest.mark.slow
def test_two_rings_in_contact_converge_at_the_orders_of_all_degrees():
    check_orders_of_rings(script(EXAMPLES / "lame_rings" / "orders.py").main())


@pytest.mark.slow
def test_the_free_edge_of_contact_limits_the_order_to_three_halves():
    orders = script(EXAMPLES / "hertz_cylinders" / "orders.py").main()
    assert 0.8 < orders[1].energy < 1.2
    assert 1.3 < orders[2].energy < 1.8
    assert 1.3 < orders[3].energy < 1.8
