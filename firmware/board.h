#pragma once

// All constants of the board, with their units. Another sensor, valve, limit or pin is a change of
// this file alone; the wiring in docs/board.md repeats the pins, and the tests follow the document.

#include <avr/io.h>
#include <stdbool.h>
#include <stdint.h>

// ---- Clock [Hz], serial line: 8N1, as `baud` of the regulator profile ---------------------------
#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#define BAUD 115200UL  // 2.1 % fast (117647) at 16 MHz, exact at 14.7456 MHz

#ifndef CHECKSUM_REQUIRED
#define CHECKSUM_REQUIRED 0  // 1: lines without a checksum are refused from the start
#endif

// ---- Channels and valves ------------------------------------------------------------------------
// Inlet: normally closed; a solenoid, or a proportional valve (VALVES_PROPORTIONAL 1) on PWM.
// Outlet: a normally open solenoid. Supply: a normally closed 3/2 valve in front of all inlets.
// So a board without power, in reset or with floating pins vents.
#ifndef VALVES_PROPORTIONAL
#define VALVES_PROPORTIONAL 0
#endif
#define PULSE_LEAST_MS 3  // shortest pulse that a solenoid follows
// Muscles that overshoot: raise FEED_PA_PER_MS if they fill much faster than in 0.25 s, lower
// BLEED_MS if they vent much faster than in 0.2 s.
#define FEED_PA_PER_MS 2000L  // a pulse of the inlet lasts for the error divided by this
#define BLEED_MS 150          // one of the outlet: this, times the error as a share of the pressure
#define DUTY_FIRST 77         // of 255: where the proportional valve begins to open
#define DUTY_PER_KPA 2        // of 255: above DUTY_FIRST, per kPa of error

// ---- Sensors: ratiometric, supplied by the chip's own 5 V ---------------------------------------
// NXP MPX5700GP (0.2 V to 4.7 V): zero 200, full 4700, low 100, high 4850.
#define SENSOR_SUPPLY_MV 5000L  // nominal, the reference of the values below
#define SENSOR_ZERO_MV 500L     // at no gauge pressure
#define SENSOR_FULL_MV 4500L    // at SENSOR_FULL_PA
#define SENSOR_FULL_PA 700000L  // gauge
#define SENSOR_LOW_MV 250L      // below: open, shorted to ground, or without supply
#define SENSOR_HIGH_MV 4750L    // above: shorted to its supply, or without ground

// ---- Limits, gauge [Pa] -------------------------------------------------------------------------
#define SET_POINT_LIMIT_PA 300000L  // set points above are refused
#define TRIP_PA 330000L             // readings above vent all channels and shut the supply
#define VENTED_PA 15000L            // no pressure; ends an over-pressure fault
#define DEAD_BAND_PA 2500L          // no valve moves for a smaller error
#define HYSTERESIS_PA 500L          // within it, where an inlet stops: above the noise of a reading
#define RISE_PA 5000L               // by which a reading must rise, or come to its set point,
#define RISE_MS \
  150  // before the inlet was open for so long in all, else not_rising:
       // raise it if large muscles are reported as that

// ---- Times [ms] ---------------------------------------------------------------------------------
#define READING_MS 10                            // of which each is the mean
#define BAD_READINGS 2                           // in a row until a fault counts
#define LOOP_MS (VALVES_PROPORTIONAL ? 10 : 20)  // of the pressure loop; the longest pulse
#define LINE_SILENCE_MS 500                      // as watchdog_s of the regulator profile
#define LINE_GAP_MS 100                          // a line that stands still for longer is dropped
#define CHIP_WATCHDOG WDTO_15MS

// ---- Pins ---------------------------------------------------------------------------------------
typedef struct {
  volatile uint8_t* port;  // its DDR is the address below
  uint8_t bit;
} Pin;

// Each inlet has its pin, the compare register of its timer, and the bit that connects the two.
// clang-format off
#if defined(__AVR_ATmega328P__)
#define CHANNELS_MOST 3
#define UART_RX_vect USART_RX_vect
#define UART_EMPTY_vect USART_UDRE_vect
// Pins of Arduino Uno and Nano. None is a line of the programmer, which would move its valve.
#define INLETS                                     \
  {{&PORTD, 6}, &OCR0A, &TCCR0A, COM0A1}, /* D6 */ \
  {{&PORTD, 5}, &OCR0B, &TCCR0A, COM0B1}, /* D5 */ \
  {{&PORTD, 3}, &OCR2B, &TCCR2A, COM2B1}  /* D3 */
#define OUTLETS {&PORTD, 2}, {&PORTD, 4}, {&PORTD, 7}  // D2, D4, D7
#define SUPPLY {&PORTB, 0}                             // D8
#define LED {&PORTB, 5}                                // D13
typedef volatile uint8_t PwmCompare;
#elif defined(__AVR_ATmega2560__)
#define CHANNELS_MOST 8
#define UART_RX_vect USART0_RX_vect
#define UART_EMPTY_vect USART0_UDRE_vect
// Pins of Arduino Mega 2560.
#define INLETS                                      \
  {{&PORTE, 3}, &OCR3A, &TCCR3A, COM3A1}, /* D5 */  \
  {{&PORTE, 4}, &OCR3B, &TCCR3A, COM3B1}, /* D2 */  \
  {{&PORTE, 5}, &OCR3C, &TCCR3A, COM3C1}, /* D3 */  \
  {{&PORTH, 3}, &OCR4A, &TCCR4A, COM4A1}, /* D6 */  \
  {{&PORTH, 4}, &OCR4B, &TCCR4A, COM4B1}, /* D7 */  \
  {{&PORTH, 5}, &OCR4C, &TCCR4A, COM4C1}, /* D8 */  \
  {{&PORTL, 3}, &OCR5A, &TCCR5A, COM5A1}, /* D46 */ \
  {{&PORTL, 4}, &OCR5B, &TCCR5A, COM5B1}  /* D45 */
#define OUTLETS /* D22 to D29 */                      \
  {&PORTA, 0}, {&PORTA, 1}, {&PORTA, 2}, {&PORTA, 3}, \
  {&PORTA, 4}, {&PORTA, 5}, {&PORTA, 6}, {&PORTA, 7}
#define SUPPLY {&PORTC, 0}  // D37
#define LED {&PORTB, 7}     // D13
typedef volatile uint16_t PwmCompare;
#else
#error "expected -mmcu=atmega328p or -mmcu=atmega2560"
#endif
// clang-format on

#ifndef CHANNELS
#define CHANNELS CHANNELS_MOST
#endif
_Static_assert(CHANNELS >= 1 && CHANNELS <= CHANNELS_MOST, "CHANNELS is out of the chip's range");
_Static_assert(SET_POINT_LIMIT_PA < TRIP_PA && TRIP_PA < SENSOR_FULL_PA, "limits out of order");
_Static_assert(SENSOR_LOW_MV < SENSOR_ZERO_MV && SENSOR_FULL_MV < SENSOR_HIGH_MV,
               "a sound sensor would count as broken");
_Static_assert(RISE_MS <= 300, "RISE_MS overflows its counter");
