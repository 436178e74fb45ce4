"""Compile the closed loop of two joints, which many tests would wait for."""

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.configuration import parameter_file

compile_setups([parameter_file.load(None)], print)
