"""Compile the closed loop of two joints, which many tests would wait for."""

from ctc_chattering.analysis.engine import compile_loop
from ctc_chattering.configuration import parameter_file

compile_loop([parameter_file.load(None)], None, print)
