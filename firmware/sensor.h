#pragma once

#include <stdint.h>

typedef enum { SENSOR_GOOD, SENSOR_LOW, SENSOR_HIGH } SensorState;

typedef struct {
  SensorState state;
  int32_t pressure_pa;  // gauge; valid only if the sensor is good
} Reading;

/// Starts the conversion of all channels in turn.
void sensorStart(void);

/// Mean of a channel's samples since the last call. A channel without samples reads SENSOR_LOW.
Reading sensorRead(uint8_t channel);
