"""What is stressed where: a table of items and kinds, checked against the tests there are.

An entry names tests of `test_<kind>.py`, or says after a dash why the item means nothing there.
Ensembles and sweeps have the tests of what they are made of, and those of `test_many.py`.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

KINDS = (
    "impact_modes",
    "existence_bands",
    "resonances",
    "stability",
    "slow_flow",
    "time_history",
    "many",
)
_SAME = "- each point or member of an ensemble is computed as if it were alone, which is tested"
_FIXED = "- structures of one or two masses, which have no such ratio"
_SCALES = "test_scales test_time_may_be_scaled"
_NO_TIME = "- nothing moves in time"
_NO_LOSS = "- impact modes have no energy loss: restitution has no effect"
_NO_LOAD = "- the model refuses loads"
MATRIX = {
    "mass ratios 1e±12": (
        "test_masses test_full_matrices",
        "test_masses test_other_families_agree_with_their_solutions",
        "test_masses",
        "test_masses",
        _FIXED,
        "test_masses",
        "test_ratios_of_all_kinds",
    ),
    "stiffness ratios 1e±12": (
        "test_stiffnesses test_full_matrices",
        "test_stiffnesses",
        "test_stiffnesses",
        "test_stiffnesses",
        _FIXED,
        "test_stiffnesses",
        "test_ratios_of_all_kinds",
    ),
    "N up to 5,000": (
        "test_long_chains test_long_chains_without_closed_form",
        "test_sign_bands_of_longer_chains test_long_chain",
        "test_thousands",
        "test_long_chains test_thousands_are_refused",
        _FIXED,
        "test_thousands",
        _SAME,
    ),
    "clustered and repeated spectra": (
        "test_clustered test_repeated",
        "test_clustered test_repeated",
        "test_clustered test_repeated",
        "test_clustered test_repeated",
        "- the masses of the coupled model are given, and with them its two frequencies",
        "test_clustered test_repeated test_three_apart_struck_in_the_same_moments",
        _SAME,
    ),
    "rigid modes": (
        "test_rigid_body test_no_stiffness",
        "test_rigid_body",
        "test_rigid_body",
        "test_rigid_body",
        "test_times_of_rest",
        "test_rigid_body",
        _SAME,
    ),
    "omega from 1e-8 to 1e8 of the spectrum": (
        "test_sixteen_decades",
        "test_above_the_spectrum test_far_below_the_spectrum",
        "test_frequencies_scale",
        "test_far_above",
        _SCALES,
        "test_frequencies test_slow_and_fast_loads_are_constant_and_nothing",
        _SAME,
    ),
    "exact poles": (
        "test_poles test_impulses_vanish_at_poles",
        "test_edges_at_poles_to_the_stated_error",
        "- natural frequencies themselves are computed",
        "test_bands_from_edge_to_edge test_multipliers_that_meet",
        _NO_LOAD,
        "test_one_mass_exactly_in_resonance test_a_chain_in_resonance_to_the_last_bit",
        _SAME,
    ),
    "gaps 1e-12 to 1e12": (
        "test_gaps test_unequal_gaps",
        "test_gaps test_a_far_and_a_near_limit_beside",
        "test_gaps_and_restitutions_play_no_part",
        "test_gaps",
        "test_scales",
        "test_gaps test_unreachable_walls_are_never_struck",
        "test_gaps_of_impact_modes test_everything_scales_with_the_gap",
    ),
    "k = 0 and 1": (
        "test_restitution_plays_no_part",
        _NO_LOSS,
        "test_gaps_and_restitutions_play_no_part",
        _NO_LOSS,
        "test_almost_no_loss test_both_ends_of_restitution",
        "test_restitutions",
        "test_grazing_restitution_and_rest_in_one_ensemble",
    ),
    "near-grazing by 1e-15": (
        "test_neighbouring_limit test_the_last_bit_decides",
        "test_a_limit_that_is_grazed_at_an_edge",
        _NO_TIME,
        "test_bands_from_edge_to_edge",
        "test_almost_grazing",
        "test_almost_grazing test_grazing_to_the_last_bit",
        "test_grazing_restitution_and_rest_in_one_ensemble",
    ),
    "three simultaneous impacts": (
        "test_three_struck_at_once",
        "test_other_families_agree_with_their_solutions",
        "- one coordinate is fixed",
        "test_stiffnesses test_the_order_of_three_impacts_decides",
        "- the models have one limiter",
        "test_three_struck_in_the_same_moment test_three_apart_struck_in_the_same_moments",
        _SAME,
    ),
    "10^7 impacts": (
        "- an impact mode is one period",
        "- an impact mode is one period",
        _NO_TIME,
        "- an impact mode is one period",
        "test_half_a_million_millions_of_impacts test_impacts_without_number",
        "test_ten_million_impacts test_millions_of_millions_of_impacts",
        _SAME,
    ),
    "Zeno": (
        _NO_LOSS,
        _NO_LOSS,
        _NO_TIME,
        _NO_LOSS,
        "test_times_of_rest",
        "test_chatter_ends_at_rest",
        "test_grazing_restitution_and_rest_in_one_ensemble",
    ),
    "loads at resonance": (
        "test_loads",
        "- loads are constant, and families with loads those of impact modes",
        "- loads play no part",
        "test_loads",
        _NO_LOAD,
        "test_one_mass_exactly_in_resonance test_a_chain_in_resonance_to_the_last_bit",
        _SAME,
    ),
    "denormals": (
        "test_denormal_entries_beside_normal_ones_are_nothing test_matrices_and_loads",
        "test_ranges_beyond_double_precision_are_refused",
        "test_denormal_springs_are_nothing",
        "test_denormal_springs_are_nothing",
        "test_numbers_that_are_lost",
        "test_numbers_whose_squares_are_lost",
        "test_refused_members_affect_no_others test_gaps_of_impact_modes",
    ),
}


@pytest.mark.parametrize("place", range(len(KINDS)), ids=KINDS)
def test_every_entry_is_a_test_or_a_reason(place: int) -> None:
    source = Path(__file__).with_name(f"test_{KINDS[place]}.py").read_text("utf-8")
    there = {node.name for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)}
    for item, row in MATRIX.items():
        assert len(row) == len(KINDS), item
        entry = row[place]
        if entry.startswith("- "):
            continue
        assert entry.split(), item
        assert set(entry.split()) <= there, item
