#pragma once

#include <stdbool.h>
#include <stdint.h>

/// Starts the serial line: 8N1 at BAUD.
void uartStart(void);

/// Takes the next received byte; false if there is none. In place of bytes that were lost or
/// damaged comes a NUL, which no line holds.
bool uartTake(uint8_t* byte);

bool uartHasInput(void);

/// Sends a text; drops all of it if it does not fit into the buffer, so that no line is cut.
void uartSay(const char* text);
