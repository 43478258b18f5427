#include "sensor.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

#include "board.h"

// Sixty-fourths of a count of the converter, whose full scale is the sensors' supply.
#define COUNTS64(millivolts) ((millivolts)*64L * 1024L / SENSOR_SUPPLY_MV)
#define SAMPLES_MOST 63  // their sum fits 16 bits

// Pressure per sixty-fourth of a count [Pa / 256].
static const int32_t kScale =
    (int32_t)(256LL * SENSOR_FULL_PA / (COUNTS64(SENSOR_FULL_MV) - COUNTS64(SENSOR_ZERO_MV)));

static volatile uint16_t sum[CHANNELS];
static volatile uint8_t samples[CHANNELS];

// AVcc as reference: the sensors' supply, so that its changes cancel.
static void convert(uint8_t channel) {
  ADMUX = _BV(REFS0) | channel;
  ADCSRA |= _BV(ADSC);
}

void sensorStart(void) {
  DIDR0 = (uint8_t)((1 << CHANNELS) - 1);
  // 125 kHz at 16 MHz: full resolution, 9615 conversions/s over all channels.
  ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
  convert(0);
}

ISR(ADC_vect) {
  static uint8_t channel;
  const uint16_t count = ADC;
  if (samples[channel] < SAMPLES_MOST) {
    sum[channel] += count;
    ++samples[channel];
  }
  channel = (uint8_t)(channel + 1 < CHANNELS ? channel + 1 : 0);
  convert(channel);
}

Reading sensorRead(uint8_t channel) {
  uint16_t total;
  uint8_t count;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    total = sum[channel];
    count = samples[channel];
    sum[channel] = 0;
    samples[channel] = 0;
  }
  // A count stands for the voltages up to the next one: half of it is added.
  const int32_t mean64 = count == 0 ? 0 : (int32_t)((uint32_t)total * 64 / count) + 32;
  Reading reading = {SENSOR_GOOD, ((mean64 - COUNTS64(SENSOR_ZERO_MV)) * kScale) / 256};
  if (mean64 < COUNTS64(SENSOR_LOW_MV)) reading.state = SENSOR_LOW;
  if (mean64 > COUNTS64(SENSOR_HIGH_MV)) reading.state = SENSOR_HIGH;
  return reading;
}
