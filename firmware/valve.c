#include "valve.h"

#include "board.h"

typedef struct {
  Pin pin;
  PwmCompare* compare;
  volatile uint8_t* control;
  uint8_t connect;  // bit of control: the pin follows the timer
} Inlet;

static const Inlet kInlets[] = {INLETS};
static const Pin kOutlets[] = {OUTLETS};
static const Pin kSupply = SUPPLY;
static const Pin kLed = LED;

static void drive(const Pin* pin, bool on) {
  const uint8_t mask = (uint8_t)_BV(pin->bit);
  if (on) {
    *pin->port |= mask;
  } else {
    *pin->port &= (uint8_t)~mask;
  }
}

static void makeOutput(const Pin* pin) {
  drive(pin, false);
  *(pin->port - 1) |= (uint8_t)_BV(pin->bit);
}

#if VALVES_PROPORTIONAL
// Fast PWM of 8 bits, 977 Hz at 16 MHz.
static void startPwm(void) {
#if defined(__AVR_ATmega328P__)
  TCCR0A = _BV(WGM01) | _BV(WGM00);
  TCCR0B = _BV(CS01) | _BV(CS00);
  TCCR2A = _BV(WGM21) | _BV(WGM20);
  TCCR2B = _BV(CS22);
#else
  TCCR3A = _BV(WGM30);
  TCCR3B = _BV(WGM32) | _BV(CS31) | _BV(CS30);
  TCCR4A = _BV(WGM40);
  TCCR4B = _BV(WGM42) | _BV(CS41) | _BV(CS40);
  TCCR5A = _BV(WGM50);
  TCCR5B = _BV(WGM52) | _BV(CS51) | _BV(CS50);
#endif
}

void inletOpen(uint8_t channel, uint8_t duty) {
  const Inlet* inlet = &kInlets[channel];
  const uint8_t mask = (uint8_t)_BV(inlet->connect);
  if (duty == 0 || duty == 255) {  // a compare value of 0 would still give one pulse in 256
    *inlet->control &= (uint8_t)~mask;
    drive(&inlet->pin, duty > 0);
  } else {
    *inlet->compare = duty;
    *inlet->control |= mask;
  }
}
#else
static void startPwm(void) {}

void inletOpen(uint8_t channel, uint8_t duty) { drive(&kInlets[channel].pin, duty > 0); }
#endif

void valveStart(void) {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    makeOutput(&kInlets[i].pin);
    makeOutput(&kOutlets[i]);
  }
  makeOutput(&kSupply);
  makeOutput(&kLed);
  startPwm();
}

void outletShut(uint8_t channel, bool shut) { drive(&kOutlets[channel], shut); }

void supplyOpen(bool open) { drive(&kSupply, open); }

void ledLight(bool on) { drive(&kLed, on); }
