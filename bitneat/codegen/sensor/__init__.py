# SPDX-License-Identifier: MIT
"""From raw sensor counts to signals and from signals to actuator counts: the map file, integer maps, and their C."""

from bitneat.codegen.sensor.emit import Member, SensorFiles, sensor_files
from bitneat.codegen.sensor.plan import SensorPlan, plan
from bitneat.codegen.sensor.read import SensorMapError, read_sensor_map

__all__ = ["Member", "SensorFiles", "SensorMapError", "SensorPlan", "plan", "read_sensor_map", "sensor_files"]
