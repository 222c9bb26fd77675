"""Every fault of the study: what it does to which file, how grave it gets, and what the pipeline owes it."""

from __future__ import annotations

from functools import partial

import numpy as np

from pipeline.faults import depth_camera, force_transducer, hostile, motion_capture, text
from pipeline.faults.fault import REFUSED, REPAIRED, UNHARMED, UNNOTICED, Change, Fault, Files, in_file, in_files

MOCAP, DEPTH, FORCE = "motion capture", "depth camera", "force transducer"
TAKE, INDEX, FRAME, FORCE_LOG = "optitrack/*.csv", "kinect/*/depth.txt", "kinect/*.png", "force/*.csv"
TRAJECTORY, CALIBRATION = "trajectory.csv", "kinect/intrinsics.yaml"
FULL_SCALE = 32.0  # N, of the transducer that the laboratory is equipped with

ROWS, FRAMES, SHARE, FACTOR, BYTES = "rows", "frames", "share of the bytes", "factor, 1", "bytes"
DIGITS = (1e3, 1e5, 1e6)
FEW = (1, 3, 10)


def _renamed_file(files: Files, severity: float, rng: np.random.Generator) -> Files:
    """The take's file has a letter in its name that is no UTF-8."""
    return {name.replace(".csv", "\udce9.csv"): content for name, content in files.items()}


def of_any_text(instrument: str, pattern: str, tag: str, rows: dict[str, tuple[tuple[str, ...], str, tuple[str, ...]]]) -> list[Fault]:
    """The faults that any log can have; ``rows`` says what is owed to lost, doubled and swapped rows and to a cut."""
    changes: dict[str, tuple[Change, str, tuple[float, ...]]] = {
        "truncated": (text.truncated, SHARE, (0.001, 0.1, 0.9)),
        "dropped rows": (text.dropped_rows, ROWS, FEW),
        "doubled rows": (text.doubled_rows, ROWS, FEW),
        "swapped rows": (text.swapped_rows, ROWS, FEW),
        "decimal commas": (text.decimal_commas, "all rows", (1,)),
        "words for numbers": (text.words_for_numbers, "cells", FEW),
        "endless number": (text.endless_number, "digits", DIGITS),
        "zeroed block": (text.zeroed_block, BYTES, (1, 100, 4096)),
    }
    refused = ((REFUSED,), "what is no number, no text or no whole row is refused with its line", ())
    found = []
    for name, (change, severity, levels) in changes.items():
        expected, rule, counted = rows.get(name, refused)
        found.append(Fault(f"{tag}: {name}", instrument, in_file(pattern, change), severity, levels, expected, rule, counted))
    return found


_BURST = ("burst of frames", (5, 20, 60))
_GAP = (
    "gaps of up to dataset.mocap.max_gap frames are filled linearly, longer ones refused; in a run dataset.limits.longest_gap, where it is "
    "stated, leaves the take out instead"
)
_LABELS = (
    "a sample farther than the gate from where the arm puts its label goes to the label it fits; in a run a take with more of them than "
    "dataset.limits.relabelled_share is left out"
)
_MISSING = "in a run a take that lacks more than dataset.limits.missing_share is left out"

MOTION_CAPTURE = [
    *of_any_text(
        MOCAP, TAKE, "take",
        {
            "truncated": ((REFUSED,), "a last row that is short is refused, as is a take of fewer frames than the motion", ()),
            "dropped rows": ((REPAIRED, REFUSED), f"frames missing between their numbers are gaps; {_GAP}", ("skipped_frames",)),
            "doubled rows": ((REPAIRED,), "a row that repeats the one before to the letter is left out", ("repeated_rows",)),
            "swapped rows": ((REFUSED,), "frame numbers have to increase", ()),
        },
    ),
    Fault("take: foreign bytes in the header", MOCAP, in_file(TAKE, text.foreign_bytes), BYTES, FEW, (REFUSED, UNHARMED),
          "text that is no UTF-8 is read byte by byte; a label or key that is then unknown is refused"),
    Fault("take: foreign byte in a marker's name", MOCAP, in_file(TAKE, motion_capture.renamed_marker), "name", (1,), (REFUSED,),
          "every marker of the option has to be there by its name"),
    Fault("take: foreign byte in the file's name", MOCAP, _renamed_file, "name", (1,), (REFUSED,),
          "a file whose name is no text cannot be named in a table"),
    Fault("take: wrong frame count in the header", MOCAP, in_file(TAKE, partial(text.header_number, b"Total Exported Frames")), FACTOR,
          (0.5, 2, 1000), (REPAIRED,), "the frames that are there count; the announced number is recorded beside theirs",
          ("announced_frames",)),
    Fault("take: wrong rate in the header", MOCAP, in_file(TAKE, partial(text.header_number, b"Export Frame Rate")), FACTOR,
          (0.5, 1.2, 2.4), (REFUSED,), "the rate has to be that of dataset.motion"),
    Fault("take: no unit in the header", MOCAP, in_file(TAKE, partial(text.header_word, b"Meters", b"")), "header", (1,), (REFUSED,),
          "a unit that neither file nor option states is asked for"),
    Fault("take: other unit in the header", MOCAP, in_file(TAKE, partial(text.header_word, b"Meters", b"Millimeters")), "header", (1,),
          (REFUSED,), "markers that fit the arm in no frame are refused"),
    Fault("take: other unit of the values", MOCAP, in_file(TAKE, motion_capture.other_lengths), FACTOR, (39.37, 100, 1000), (REFUSED,),
          "markers that fit the arm in no frame are refused"),
    Fault("take: link hidden", MOCAP, in_file(TAKE, motion_capture.hidden_link), *_BURST, (REPAIRED, REFUSED), _GAP, ("interpolated",)),
    Fault("take: samples hidden", MOCAP, in_file(TAKE, motion_capture.hidden_samples), "share of the samples", (0.01, 0.1, 0.3),
          (REPAIRED,), f"two markers give a link's angle; {_GAP}; {_MISSING}", ("missing",)),
    Fault("take: labels swapped on a link", MOCAP, in_file(TAKE, motion_capture.swapped_labels), *_BURST, (REPAIRED,), _LABELS,
          ("relabelled",)),
    Fault("take: labels swapped between links", MOCAP, in_file(TAKE, motion_capture.swapped_links), *_BURST, (REPAIRED,), _LABELS,
          ("relabelled",)),
    Fault("take: label lost", MOCAP, in_file(TAKE, motion_capture.lost_label), *_BURST, (REPAIRED,), _LABELS, ("adopted",)),
    Fault("take: tracker frozen", MOCAP, in_file(TAKE, motion_capture.frozen_tracker), *_BURST, (REPAIRED, REFUSED),
          f"a frame that repeats every position of the one before was not measured; {_GAP}", ("frozen_frames",)),
]  # fmt: skip

_IMAGE = "a frame that cannot be decoded whole, at the size of the camera, is refused"
_CLOCK = (
    "the offset of the camera's clock, and its drift, are estimated against the markers; of a changing offset the mean is used; in a run a "
    "take beyond dataset.limits.clock_drift or .clock_offset_standard_error is left out"
)
_NOISE = "within three standard errors a change is not told from none"

DEPTH_CAMERA = [
    *of_any_text(
        DEPTH, INDEX, "index",
        {
            "truncated": ((REPAIRED, REFUSED, UNNOTICED),
                          "a last line without end is left out; a cut between lines leaves a shorter sequence, or too short a one",
                          ("cut_rows",)),
            "dropped rows": ((REPAIRED, REFUSED), "a step of several frame times is that many dropped frames; in a run a take with more of "
                             "them than dataset.limits.dropped_share is left out", ("dropped_frames",)),
            "doubled rows": ((REFUSED,), "times have to increase", ()),
            "swapped rows": ((REFUSED,), "times have to increase", ()),
        },
    ),
    Fault("frames: missing", DEPTH, depth_camera.lost_files, FRAMES, FEW, (REFUSED,), "a frame that the index names has to be there"),
    Fault("frames: flipped bit", DEPTH, in_files(FRAME, depth_camera.flipped_bits), FRAMES, FEW, (REFUSED,), _IMAGE),
    Fault("frames: truncated", DEPTH, in_file(FRAME, text.truncated), SHARE, (0.001, 0.1, 0.9), (REFUSED,), _IMAGE),
    Fault("frames: fewer rows than announced", DEPTH, in_file(FRAME, depth_camera.shortened_pixels), "share of the rows", (0.01, 0.1, 0.9),
          (REFUSED,), _IMAGE),
    Fault("frames: more rows announced", DEPTH, in_file(FRAME, depth_camera.other_size), "rows", (1, 100, 2e9), (REFUSED,), _IMAGE),
    Fault("frames: image bomb", DEPTH, in_file(FRAME, depth_camera.image_bomb), "MB unfolded", (10, 30, 100), (REFUSED,), _IMAGE),
    Fault("frames: text bomb", DEPTH, in_file(FRAME, depth_camera.text_bomb), "MB unfolded", (10, 30, 100), (REFUSED, UNHARMED), _IMAGE),
    Fault("frames: camera frozen", DEPTH, depth_camera.frozen_camera, FRAMES, FEW, (REPAIRED, REFUSED),
          "a frame that is the one before it, pixel by pixel, was not measured and is left out", ("frozen_frames",)),
    Fault("frames: pixels lost", DEPTH, depth_camera.lost_pixels, "share of the pixels", (0.1, 0.5, 0.95), (REPAIRED, REFUSED),
          "a frame with too few points is left out, too many of them are refused", ("valid", "frames_without_fit")),
    Fault("frames: other unit", DEPTH, depth_camera.other_unit, FACTOR, (0.2, 0.5, 5), (REFUSED,),
          "the points seen have to move as the markers do"),
    Fault("frames: clock offset", DEPTH, in_file(INDEX, depth_camera.other_clock), "s", (0.02, 0.1, 5), (REPAIRED, REFUSED, UNNOTICED),
          f"{_CLOCK}; {_NOISE}", ("clock_offset",)),
    Fault("frames: clock drift", DEPTH, in_file(INDEX, depth_camera.drifting_clock), "s/s", (0.01, 0.03, 0.1),
          (REPAIRED, REFUSED, UNNOTICED), f"{_CLOCK}; {_NOISE}", ("clock_offset", "clock_drift")),
    Fault("frames: clock jump", DEPTH, in_file(INDEX, depth_camera.jumping_clock), "s", (0.02, 0.1, 5), (REPAIRED, REFUSED, UNNOTICED),
          f"{_CLOCK}; {_NOISE}", ("clock_offset", "clock_drift", "dropped_frames")),
    *of_any_text(DEPTH, TRAJECTORY, "trajectory",
                  {name: ((REFUSED,), "times have to step evenly, as many as the motion has", ())
                   for name in ("truncated", "dropped rows", "doubled rows", "swapped rows")}),
    Fault("calibration: truncated", DEPTH, in_file(CALIBRATION, text.truncated), SHARE, (0.001, 0.1, 0.9), (REFUSED, UNHARMED),
          "matrix and coefficients have to be there whole"),
    Fault("calibration: wrong row count", DEPTH, in_file(CALIBRATION, partial(text.header_number, b"rows")), FACTOR, (0, 2, 1e8),
          (REFUSED,), "a camera matrix has three rows and three columns"),
    Fault("calibration: wrong number format", DEPTH, in_file(CALIBRATION, hostile.other_type), "header", (1,), (REFUSED,),
          "a matrix of whole numbers would hold others than the file"),
    Fault("calibration: alias bomb", DEPTH, in_file(CALIBRATION, hostile.alias_bomb), "levels of nine", (3, 9, 30), (REFUSED,),
          "a calibration has no references"),
    Fault("calibration: named code", DEPTH, in_file(CALIBRATION, hostile.named_code), "call", (1,), (REFUSED,),
          "a calibration holds data alone"),
    Fault("calibration: nested lists", DEPTH, in_file(CALIBRATION, hostile.nested_lists), "levels", (10, 1e3, 1e5), (REFUSED,),
          "a calibration has nine numbers"),
]  # fmt: skip

_NO_CLOCK = "not noticed: the program writes neither times nor sample numbers; in a log with a column of them lost rows leave a gap"

FORCE_TRANSDUCER = [
    *of_any_text(
        FORCE, FORCE_LOG, "log",
        {
            "truncated": ((REPAIRED, REFUSED, UNNOTICED),
                          "a last row that is short or has no end is left out; a cut between rows leaves a shorter log", ("cut_rows",)),
            "dropped rows": ((UNNOTICED,), _NO_CLOCK, ()),
            "doubled rows": ((REPAIRED,), "kept, as slow sensors are read twice; counted", ("repeated_rows",)),
            "swapped rows": ((UNHARMED, UNNOTICED), f"{_NO_CLOCK}; moments have no order", ()),
        },
    ),
    Fault("log: foreign bytes in the header", FORCE, in_file(FORCE_LOG, text.foreign_bytes), BYTES, FEW, (REFUSED, UNHARMED),
          "text that is no UTF-8 is read byte by byte; a label that is then unknown is refused"),
    Fault("log: wrong rate in the header", FORCE, in_file(FORCE_LOG, partial(text.header_number, b"Frequency")), FACTOR, (0.5, 2, 10),
          (REFUSED,), "the rate has to be that of the option"),
    Fault("log: other unit in the header", FORCE, in_file(FORCE_LOG, partial(text.header_word, b"(N)", b"(lbf)")), "header", (1,),
          (REFUSED,), "the unit has to be that of the option"),
    Fault("log: saturated", FORCE, in_file(FORCE_LOG, partial(force_transducer.saturated, FULL_SCALE)), "share of the samples",
          (0.002, 0.008, 0.1), (REPAIRED, REFUSED), "counted and left out up to dataset.force.log.max_faulty, then refused",
          ("saturated_samples",)),
    Fault("log: frozen", FORCE, in_file(FORCE_LOG, force_transducer.frozen_sensor), "share of the samples", (0.002, 0.008, 0.1),
          (REPAIRED, REFUSED), "repeats are counted; beyond frozen_after they are frozen, and beyond max_faulty refused",
          ("repeated_rows", "frozen_samples")),
]  # fmt: skip

FAULTS = {fault.name: fault for fault in (*MOTION_CAPTURE, *DEPTH_CAMERA, *FORCE_TRANSDUCER)}
