#pragma once

#include <stdbool.h>
#include <stdint.h>

/// Makes the valves' pins outputs, all without current: every channel vents, the supply is shut.
void valveStart(void);

/// Opens a channel's inlet: 0 shut, 255 wide open. A solenoid is open at any other value.
void inletOpen(uint8_t channel, uint8_t duty);
/// Shuts a channel's outlet, or lets its air out.
void outletShut(uint8_t channel, bool shut);
/// Lets air to the inlets, or empties the line in front of them.
void supplyOpen(bool open);
void ledLight(bool on);
