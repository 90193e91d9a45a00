"""The usual origin of each kind of error in the workshop, and its repair, beside the remedies of the effects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Workshop(NamedTuple):
    """Two sentences on a kind of error."""

    origin: str
    repair: str


_GEOMETRY = "Level the machine, scrape or shim the guide, or set the axis line; measure again."
_HEAT = "Warm the machine up before measuring and cutting, shield it from draughts and coolant, or add a sensor."
_SPINDLE = "Warm the spindle up, check its bearings and its cooling, or measure the tool again before finishing."
_TRACKER = "Let the instrument warm up, fix its stand, and measure again."

WORKSHOP: Mapping[str, Workshop] = {
    "error-motion": Workshop(
        "Form of the guides and of the scale: machining, mounting, wear, a foundation that has moved.", _GEOMETRY
    ),
    "location": Workshop(
        "Assembly or a collision: guides that are not square, a rotary axis beside its nominal line.",
        "Set the axis line or the kinematic parameters of the control; after a collision check the fixing screws.",
    ),
    "location-jump": Workshop(
        "A collision, a lost reference point or a loosened fixing between two measurements.",
        "Find the event at the given moment, reference the axis again, check the screws; measure again.",
    ),
    "scale": Workshop(
        "A wrong screw pitch or scale factor in the control, or a scale at another temperature.",
        "Correct the scale factor of the axis in the control.",
    ),
    "cross-axis": Workshop(
        "The moving mass bends the structure: sag of an arm, twist of a column, shift of the table's weight.",
        "Counterbalance or stiffen the structure; otherwise a cross-axis table or the corrected program.",
    ),
    "racking": Workshop(
        "The two drives of a gantry are not synchronous, or their scales differ.",
        "Set the gantry offset of the second drive in the control, and check its scale.",
    ),
    "wobble": Workshop(
        "Eccentric or tilted bearing, encoder ring or table plate of the rotary axis.",
        "Centre the plate or the encoder ring, or replace the bearing.",
    ),
    "joint-compliance": Workshop(
        "Gears and bearings of the rotary axis yield under the weight of the tool or the workpiece.",
        "Reduce the load, clamp the axis while cutting, or tighten the gear.",
    ),
    "ram-sag": Workshop(
        "The weight of the ram bends it as it comes out.", "Set the hydraulic or electric sag compensation of the ram."
    ),
    "backlash": Workshop(
        "Play in nut, gear or bearing, or wind-up of a screw in an axis without a direct scale.",
        "Preload or replace the nut and the thrust bearing; otherwise set the backlash of the control.",
    ),
    "reversal": Workshop(
        "Play or friction that differs along the travel, by wear at the positions that are used most.",
        "Replace the worn part of the drive, or a bidirectional table.",
    ),
    "lateral-play": Workshop(
        "Worn or loose gibs and carriages: the slide tilts or steps aside when it turns back.",
        "Set the gibs or the preload of the carriages.",
    ),
    "hysteresis": Workshop(
        "Elastic parts between drive and scale with friction: seals, covers, cable chain, dry guides.",
        "Lubricate the guides, check covers and the cable chain, and the mounting of the scale.",
    ),
    "reversal-spike": Workshop(
        "Friction at standstill that the drive overcomes late.", "Set the friction compensation of the drive."
    ),
    "cyclic": Workshop(
        "Eccentric screw, pinion or encoder, or an encoder signal that is not a clean sine.",
        "Clean and align the reading head, check the coupling and the bearing of the screw.",
    ),
    "quantised-compensation": Workshop(
        "A compensation table of the control with nodes that are far apart or not interpolated.",
        "Write a table with closer nodes, or switch interpolation on.",
    ),
    "control-table": Workshop(
        "A compensation table is active in the control.", "Keep it, or switch it off and write the new one instead."
    ),
    "following-error": Workshop(
        "Lag of the position loop with the feed, or elastic deformation with the acceleration.",
        "Set the gain and the feed forward of the drive; finish at a lower feed.",
    ),
    "servo-mismatch": Workshop(
        "Two axes have different position gains, so that a circle becomes an ellipse.",
        "Match the position gains of the axes.",
    ),
    "settling": Workshop(
        "The axis was measured before it had settled.", "Use a longer dwell, and check the positioning window."
    ),
    "first-cycle": Workshop(
        "Oil film, preload or temperature differ in the first cycle.", "Move the axes for some minutes before a test."
    ),
    "thermal-drift": Workshop("Growth of spindle, column or head as the machine warms up.", _SPINDLE),
    "thermal-drift-sensor": Workshop("Growth of spindle, column or head with the temperature of a sensor.", _SPINDLE),
    "thermal-drift-duty": Workshop("Heat of the spindle's bearings by its speed.", _SPINDLE),
    "thermal-drift-workpiece": Workshop("The table, the fixture or the part warms up or relaxes.", _HEAT),
    "thermal-drift-workpiece-sensor": Workshop("The table, the fixture or the part follows a temperature.", _HEAT),
    "thermal-scale": Workshop("The screw or the scale of the axis warms up and grows.", _HEAT),
    "thermal-scale-sensor": Workshop("The screw or the scale of the axis follows a temperature.", _HEAT),
    "thermal-scale-quadratic": Workshop("The scale and its carrier grow differently with the temperature.", _HEAT),
    "thermal-scale-duty": Workshop("Friction warms the screw as the axis travels.", _HEAT),
    "thermal-distortion": Workshop("One side of the structure warms up more than the other.", _HEAT),
    "thermal-distortion-sensor": Workshop("One side of the structure follows a temperature more than another.", _HEAT),
    "unnamed": Workshop(
        "Not known: no cause of the library fits.", "Make the proposed measurement before any repair."
    ),
    "station-shift": Workshop("The instrument or its stand has moved between two set-ups.", _TRACKER),
    "tracker-drift": Workshop("The instrument or its stand moves slowly: warm-up, floor, tripod.", _TRACKER),
    "tracker-range": Workshop(
        "The home position (birdbath) or the constant of the reflector is wrong.", "Set the home position again."
    ),
    "tracker-range-drift": Workshop("The range unit of the instrument drifts.", _TRACKER),
    "air-scale": Workshop(
        "Wrong air temperature, pressure or humidity in the instrument.", "Check the weather station; measure again."
    ),
    "air-scale-drift": Workshop(
        "The air has changed since the weather values were entered.", "Connect the weather station to the instrument."
    ),
    "tracker-angle": Workshop(
        "Eccentric angle encoder or axes of the instrument that are not square.",
        "Compensate the instrument (two-face test), and send it to its maker if the error stays.",
    ),
    "tracker-angle-step": Workshop(
        "Dirt on an angle encoder's disc, a damaged cable, or an axis of the instrument that gives way there.",
        "Clean and compensate the instrument; measure again from another place.",
    ),
    "target-offset": Workshop(
        "A reflector is not seated in its nest, or its position is stated wrong.", "Clean the nest; measure the target."
    ),
    "late-read-back": Workshop(
        "The clocks of control and instrument differ.", "Synchronise the clocks, or use a trigger."
    ),
    "cmm-scale": Workshop(
        "Scale of the coordinate measuring machine, or a part that is not at 20 °C on it.",
        "Let the part take the temperature of the room; check the machine with a gauge.",
    ),
    "cmm-squareness": Workshop(
        "Axes of the coordinate measuring machine that are not square.", "Measure the part in turned positions too."
    ),
    "unknown-approach": Workshop(
        "The axis had not moved before the first rows, so that its side of the backlash is unknown.",
        "Move every axis once in the same direction before the measurement.",
    ),
    "outliers": Workshop(
        "Single rows: a broken beam, a bump, a wrong point.", "Look at the listed rows; measure them again."
    ),
}  # fmt: skip
"""By kind of effect."""
