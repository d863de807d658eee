"""Integrity: ADS-B is believed only as far as radars confirm it.

cover.py      where a radar would see an aircraft
agreement.py  do own positions fit what radars see
integrity.py  the front: unverified, verified, suspect; alarms
"""

from aeroskein.integrity.integrity import Belief, Integrity, Looks, OwnPositions

__all__ = ["Belief", "Integrity", "Looks", "OwnPositions"]
