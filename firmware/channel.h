#pragma once

#include <stdbool.h>
#include <stdint.h>

/// Why a channel vents and accepts no set points; a greater value replaces a smaller one.
typedef enum {
  FAULT_NONE,
  FAULT_RESTARTED,      ///< the chip has started, whatever it did before
  FAULT_LINE_LOST,      ///< no set line for LINE_SILENCE_MS
  FAULT_NOT_RISING,     ///< fed, but the reading stands: no supply, a shut inlet, a blocked sensor
  FAULT_OVER_PRESSURE,  ///< of this or another channel: all vent
  FAULT_SENSOR_LOW,
  FAULT_SENSOR_HIGH
} Fault;

/// All channels vent, with FAULT_RESTARTED.
void channelsStart(void);
/// One millisecond: readings and faults, pressure loop, valves.
void channelsTick(void);
/// A set line has come: the line is alive.
void channelsHeard(void);

/// Regulates to a set point of 0 to SET_POINT_LIMIT_PA [Pa], or neither feeds nor vents; without
/// effect on a channel with a fault.
void channelRegulate(uint8_t channel, int32_t set_point_pa);
void channelClose(uint8_t channel);
/// Vents, and ends the channel's fault where its cause is gone.
void channelVent(uint8_t channel);

/// Gauge pressure of the last good reading [Pa].
int32_t channelPressure(uint8_t channel);
Fault channelFault(uint8_t channel);
/// Whether any channel has a fault that a vent line alone does not end.
bool channelsTripped(void);
/// Whether any channel regulates or is closed.
bool channelsHold(void);
