"""Yaw's words and keys as another motion has them; on its way out: texts are to be filled from the record instead."""

import re
from collections.abc import Mapping
from typing import Any


def word_pattern(text: str) -> str:
    """A pattern of the text as a whole word, and no part of a name of a file or of an effect (`bias-moment`)."""
    if not text.isascii():  # Greek letters and degree signs stand as they like
        return re.escape(text)
    before = r"(?<![\w/-])" if text[0].isalpha() else ""
    after = r"(?![\w|/]|[.-]\w)" if text[-1].isalnum() else ""
    return before + re.escape(text) + after


def renamed(content: Any, keys: Mapping[str, str]) -> Any:
    """Plain data with some keys called otherwise, however deep they are."""
    if not keys:
        return content
    if isinstance(content, dict):
        return {keys.get(key, key): renamed(value, keys) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return type(content)(renamed(value, keys) for value in content)
    return content


def keys_of(symbol: str, letter: str, mass: str, position: str) -> dict[str, str]:
    """Keys of yaw's result files and what a translation has in their place."""
    drag = f"{symbol}_{letter}"
    symbol_axis = {"X": "surge", "Z": "heave"}
    return {
        "I_r": mass,
        "k_r": drag,
        "k_rr": f"{drag}{letter}",
        "k_rrr": f"{drag}{letter}{letter}",
        "moment": "force",
        "moments": "forces",
        "moment_unit": "force_unit",
        "moment_most": "force_most",
        "added_moment": "added_force",
        "inertial_turn_angle_rad": "inertial_distance_m",
        "tail_from_deg": "tail_from_cm",
        "heading_noise_deg": f"{position}_noise_cm",
        "heading_zero_deg": f"{position}_zero_m",
        "heading_zero_rad": f"{position}_zero_m",
        "start_heading_deg": f"start_{position}_m",
        "start_heading_rad": f"start_{position}_m",
        "heading_deg": f"{position}_cm",
        "I_r_mean_at_moment": f"{mass}_mean_at_force",
        "yaw_rate_rad_s": f"{symbol_axis[symbol]}_m_s",
        "turn_deg": "travel_m",
        "turned_deg": "covered_cm",
        "turns": "covered_m",
        "noise_deg": "noise_m",
        "quantisation_deg": "quantisation_m",
        "glitch_deg": "glitch_m",
        "rate_noise_deg_s": "speed_noise_m_s",
        "rate_bias_deg_s": "speed_bias_m_s",
        "rate_bias_rad_s": "speed_bias_m_s",
        "rate_deg_s": "speed_cm_s",
        "start_rate_deg_s": "start_speed_cm_s",
        "steady_rate_deg_s": "steady_speed_cm_s",
        "steady_rate_stderr_deg_s": "steady_speed_stderr_cm_s",
        "velocity_error_deg": "velocity_error_cm",
        **{
            f"{score}_deg{more}": f"{score}_cm{more}"
            for score in ("rmse", "max_abs", "restarted_rmse")
            for more in ("", "_ci95")
        },
        **{f"rate_rmse_deg_s{more}": f"speed_rmse_cm_s{more}" for more in ("", "_ci95")},
        **{f"{gap}_deg": f"{gap}_cm" for gap in ("before", "after", "gap", "noise_floor")},
    }


def words_of(
    dof: str, symbol: str, letter: str, mass: str, position: str, ways: tuple[str, str]
) -> dict[str, str]:
    """Words about yaw and what is said of a translation; `position` is what the log holds."""
    ahead, astern = ways
    place = "z" if position == "depth" else "x"
    lower = {
        "yaw rate": f"{dof} speed",
        "yaw-rate": f"{dof}-speed",
        "steady rate": "steady speed",
        "to starboard": ahead,
        "to port": astern,
        "to both sides": "both ways",
        "to each side": "each way",
        "to one side": "one way",
        "starboard": ahead,
        "port": astern,
        "yaw": dof,
        "yaw moment": f"{dof} force",
        "yaw moments": f"{dof} forces",
        "yaw inertia": "mass with added mass",
        "moment": "force",
        "moments": "forces",
        "inertia": "mass",
        "an inertia": "a mass",
        "inertial turn angle": "inertial distance",
        "inertial turn angles": "inertial distances",
        "turned angle": "distance covered",
        "turned-angle": "distance-covered",
        "half-turn": "step",
        "torsional spring": "spring",
        "torsional stiffness": "stiffness",
        "half-turns": "steps",
        "half a turn": "the way allowed",
        "degrees of turn": "cm of way",
        "of turn": "of way",
        "compass": f"{position} sensor",
        "heading": position,
        "headings": f"{position}s",
        "start-heading": f"start-{position}",
        "turn": "move",
        "turns": "moves",
        "turned": "moved",
        "turning": "moving",
        "a whole revolution and more": "the whole way",
        "an unwinding turn": "back again",
        "degree": "cm",
        "degrees": "cm",
    }
    upper = {key[0].upper() + key[1:]: word[0].upper() + word[1:] for key, word in lower.items()}
    symbols = {
        "I_r": mass,
        "k_r": f"{symbol}_{letter}",
        "k_rr": f"{symbol}_{letter}{letter}",
        "k_r|r|": f"{symbol}_{letter}|{letter}|",
        "k_{r|r|}": f"{symbol}_{{{letter}|{letter}|}}",
        "/I_r)": f"/{mass})",
        "|moment|": "|force|",
        "psi": place,
        "psi_m": f"{place}_m",
        "psi_start": f"{place}_start",
        "I_r/k_r|r|": f"{mass}/{symbol}_{letter}|{letter}|",
        "I_r/k_{r|r|}": f"{mass}/{symbol}_{{{letter}|{letter}|}}",
        "yaw rate r": f"{dof} speed {letter}",
        "Steady yaw rate r": f"Steady {dof} speed {letter}",
        "τ": symbol,
        "ψ": place,
        "ψ₀": f"{place}₀",
        r"\tau": symbol,
        r"\psi": place,
        "deg": "cm",
        "deg/s": "cm/s",
        "°": " cm",
        "rad": "m",
        "rad/s": "m/s",
    }
    return {**lower, **upper, **symbols}
