"""Faults of cameras, clocks and cables, found while the events come."""

from gpvo.faults.fault import Fault
from gpvo.faults.watch import FaultWatch

__all__ = ["Fault", "FaultWatch"]
