#include "channel.h"

#include "board.h"
#include "sensor.h"
#include "valve.h"

typedef enum { MODE_VENT, MODE_REGULATE, MODE_CLOSE } Mode;

typedef struct {
  Mode mode;
  Fault fault;
  int32_t set_point_pa;
  int32_t pressure_pa;
  int32_t ahead_pa;  // extrapolated by one reading: mean and valves lag behind
  uint8_t broken;    // readings in a row
  uint8_t over;      // the same
  uint8_t duty;      // of the inlet during feed_ms
  uint8_t feed_ms;
  uint8_t bleed_ms;
  bool fills;  // fed in this period
  int32_t rises_from_pa;
  uint16_t fed;  // since then: duty above DUTY_FIRST times ms
} Channel;

static Channel channels[CHANNELS];
static uint16_t silence_ms;

static void fail(Channel* channel, Fault fault) {
  if (channel->fault < fault) channel->fault = fault;
  channel->mode = MODE_VENT;
}

static void read(uint8_t i) {
  Channel* channel = &channels[i];
  const Reading reading = sensorRead(i);
  if (reading.state == SENSOR_GOOD) {
    channel->broken = 0;
    channel->ahead_pa = 2 * reading.pressure_pa - channel->pressure_pa;
    channel->pressure_pa = reading.pressure_pa;
    channel->over = (uint8_t)(reading.pressure_pa <= TRIP_PA ? 0 : channel->over + 1);
  } else {
    ++channel->broken;
  }
  if (channel->broken >= BAD_READINGS) {
    channel->broken = BAD_READINGS;
    fail(channel, reading.state == SENSOR_LOW ? FAULT_SENSOR_LOW : FAULT_SENSOR_HIGH);
  }
  if (channel->over >= BAD_READINGS) {
    channel->over = BAD_READINGS;
    // The air that overfills this channel comes from the supply of all channels.
    for (uint8_t k = 0; k < CHANNELS; ++k) fail(&channels[k], FAULT_OVER_PRESSURE);
  }
}

// A muscle that is fed while its reading does not rise may fill up to the supply pressure.
static void watchRise(Channel* channel) {
  const bool rises = channel->pressure_pa >= channel->rises_from_pa + RISE_PA;
  if (rises || !channel->fills) {
    channel->rises_from_pa = channel->pressure_pa;
    channel->fed = 0;
  } else {
    channel->fed += channel->feed_ms * (uint16_t)(channel->duty - DUTY_FIRST);
    if (channel->fed >= RISE_MS * (uint16_t)(255 - DUTY_FIRST)) fail(channel, FAULT_NOT_RISING);
  }
}

static uint8_t pulse(int32_t length_ms) {
  if (length_ms < PULSE_LEAST_MS) return PULSE_LEAST_MS;
  return (uint8_t)(length_ms > LOOP_MS ? LOOP_MS : length_ms);
}

static void feed(Channel* channel, int32_t error_pa) {
#if VALVES_PROPORTIONAL
  const int32_t duty = DUTY_FIRST + error_pa * DUTY_PER_KPA / 1000;
  channel->duty = (uint8_t)(duty > 255 ? 255 : duty);
  channel->feed_ms = LOOP_MS;
#else
  channel->duty = 255;
  channel->feed_ms = pulse(error_pa / FEED_PA_PER_MS);
#endif
}

static void regulate(Channel* channel) {
  const int32_t error_pa = channel->set_point_pa - channel->ahead_pa;
  // Hysteresis: the noise of a constant reading must not reset the count of watchRise().
  const int32_t least_pa = channel->fills ? DEAD_BAND_PA - HYSTERESIS_PA : DEAD_BAND_PA;
  // One bad reading is not a fault yet, but the valves must not act on it.
  const bool regulates = channel->mode == MODE_REGULATE && channel->broken == 0;
  channel->feed_ms = channel->bleed_ms = 0;
  channel->fills = regulates && channel->set_point_pa > 0 && error_pa > least_pa;
  if (channel->fills) {
    feed(channel, error_pa);
  } else if (regulates && channel->set_point_pa == 0) {
    channel->bleed_ms = LOOP_MS;
  } else if (regulates && error_pa < -DEAD_BAND_PA) {
    channel->bleed_ms = pulse(-error_pa * BLEED_MS / channel->ahead_pa);
  }
  watchRise(channel);
}

static void drive(uint8_t i) {
  Channel* channel = &channels[i];
  const bool regulates = channel->mode == MODE_REGULATE;
  const bool feeds = regulates && channel->feed_ms > 0;
  const bool bleeds = regulates && channel->bleed_ms > 0;
  if (feeds) --channel->feed_ms;
  if (bleeds) --channel->bleed_ms;
  inletOpen(i, feeds ? channel->duty : 0);
  outletShut(i, channel->mode != MODE_VENT && !bleeds);
}

void channelsStart(void) {
  for (uint8_t i = 0; i < CHANNELS; ++i) channels[i].fault = FAULT_RESTARTED;
}

void channelsTick(void) {
  static uint8_t reading_ms, loop_ms;
  if (silence_ms < LINE_SILENCE_MS) ++silence_ms;
  if (++reading_ms >= READING_MS) {
    reading_ms = 0;
    for (uint8_t i = 0; i < CHANNELS; ++i) read(i);
  }
  const bool lost = silence_ms >= LINE_SILENCE_MS;
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if (lost && channels[i].mode != MODE_VENT) fail(&channels[i], FAULT_LINE_LOST);
  }
  if (++loop_ms >= LOOP_MS) {
    loop_ms = 0;
    for (uint8_t i = 0; i < CHANNELS; ++i) regulate(&channels[i]);
  }
  for (uint8_t i = 0; i < CHANNELS; ++i) drive(i);
  supplyOpen(channelsHold());
}

void channelsHeard(void) { silence_ms = 0; }

void channelRegulate(uint8_t i, int32_t set_point_pa) {
  if (channels[i].fault != FAULT_NONE) return;
  channels[i].mode = MODE_REGULATE;
  channels[i].set_point_pa = set_point_pa;
}

void channelClose(uint8_t i) {
  if (channels[i].fault == FAULT_NONE) channels[i].mode = MODE_CLOSE;
}

void channelVent(uint8_t i) {
  Channel* channel = &channels[i];
  channel->mode = MODE_VENT;
  const bool stands = channel->fault == FAULT_OVER_PRESSURE && channel->pressure_pa > VENTED_PA;
  if (channel->broken == 0 && !stands) channel->fault = FAULT_NONE;
}

int32_t channelPressure(uint8_t i) { return channels[i].pressure_pa; }

Fault channelFault(uint8_t i) { return channels[i].fault; }

bool channelsTripped(void) {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if (channels[i].fault > FAULT_LINE_LOST) return true;
  }
  return false;
}

bool channelsHold(void) {
  for (uint8_t i = 0; i < CHANNELS; ++i) {
    if (channels[i].mode != MODE_VENT) return true;
  }
  return false;
}
