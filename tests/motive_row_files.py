"""Rows of row-typed Motive files for tests."""

from __future__ import annotations

from pipeline.formats.motion.motive import read_motive
from pipeline.formats.motion.take import MotionTake

POSE = "7,{0}.5,2,3,0,0,0,1,0,0,0"


DEFINITION = 'rigidbody,"Arm",7,2,0.1,0,0,-0.1,0,0'


def in_metres(file) -> MotionTake:
    return read_motive(file, "m")


def frame_row(k: int, markers: str = "0", *, tracked: bool = True) -> str:
    return f"frame,{k},{k / 100:.8f},{'1,' + POSE.format(k % 100) if tracked else '0'},{markers}"


def body_row(k: int, first: str, second: str) -> str:
    solved = "9,9,9,2,9,9,9,4"
    return f'rigidbody,{k},{k / 100:.8f},"Arm",7,0,2,{solved},{first},{second},1,1,0.9,0.9,0.002'


def seen_row(k: int) -> str:
    return frame_row(k, f"2,{k},0,1,2,Arm-Marker 1,{k},5,5,40{k},Marker-40{k}")
