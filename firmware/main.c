// Firmware of a board that regulates the pressures of up to 8 muscles, docs/board.md.

#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "board.h"
#include "channel.h"
#include "line.h"
#include "sensor.h"
#include "uart.h"
#include "valve.h"

// Crystal; brown-out reset at 4.3 V; chip watchdog that no program can switch off; no bootloader,
// and on the larger chip no JTAG, which takes four of the sensors' pins.
FUSES = {.low = 0xFF,
         .high = FUSE_SPIEN & FUSE_WDTON & FUSE_BOOTSZ1 & FUSE_BOOTSZ0,
         .extended = FUSE_BODLEVEL1 & FUSE_BODLEVEL0};

static volatile uint8_t ticks;

ISR(TIMER1_COMPA_vect) { ++ticks; }

static void startTicks(void) {
  OCR1A = F_CPU / 8 / 1000 - 1;
  TCCR1B = _BV(WGM12) | _BV(CS11);
  TIMSK1 = _BV(OCIE1A);
}

// Steady: a channel holds pressure. 1 Hz: all vent. 5 Hz: a fault that needs attention.
static void showState(void) {
  static uint16_t ms;
  const uint16_t half_ms = channelsTripped() ? 100 : 500;
  if (++ms >= 2 * half_ms) ms = 0;
  ledLight(ms < half_ms || (channelsHold() && !channelsTripped()));
}

int main(void) {
  // After a watchdog reset it runs on, at 16 ms; the flag would keep its time from being changed.
  MCUSR = 0;
  wdt_enable(CHIP_WATCHDOG);
  valveStart();
  channelsStart();
  sensorStart();
  startTicks();
  uartStart();
  set_sleep_mode(SLEEP_MODE_IDLE);
  sei();
  for (uint8_t done = 0;;) {
    if (done != ticks) {
      ++done;
      wdt_reset();
      channelsTick();
      lineTick();
      showState();
    }
    lineRun();
    // If an interrupt comes just before the sleep, the next one, of the converter, ends the sleep.
    if (done == ticks && !uartHasInput()) sleep_mode();
  }
}
