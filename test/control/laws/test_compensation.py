"""Law (2); test/control/test_controller.py has it by hand."""

from laws import rattles


def test_too_large_a_gain_rattles() -> None:
    """Check c h Kv < 2 from both sides, with M̂ = c M."""
    assert rattles('compensation', {'kv': [1900.0] * 2}, {'kv': [2100.0] * 2})
    assert rattles('compensation', {'kv': [900.0] * 2, 'inertia_scale': 2.0},
                   {'kv': [1100.0] * 2, 'inertia_scale': 2.0})
