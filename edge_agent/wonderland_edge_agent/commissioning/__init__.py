"""Commissioning a pad: survey, calibration run, fitted bias tables with their uncertainty, what the pad can settle.

Modules that calculate (``run``, ``curves``, ``spread``, ``fit``, ``reach``, ``self_survey``, ``plots``) need NumPy,
SciPy and Matplotlib (the extra ``commission``); a running pad's agent never loads them.
"""
