#include "line.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <util/crc16.h>

#include "board.h"
#include "channel.h"
#include "uart.h"

#define LINE_MOST 24  // no line of the protocol is longer, its checksum included
#define ANSWER_MOST 32
#define CHECKSUM_SIZE 5      // "*" and four digits
#define WHOLE_DIGITS_MOST 5  // of kPa: with three decimals they fit 32 bits
#define DECIMALS 3           // of kPa: whole pascals

static char text[LINE_MOST + 1];
static uint8_t length;
static bool spoilt;  // until the end of the line
static uint8_t gap_ms;
// Whether lines without a checksum are refused: once the host has sent one, it sends them always.
static bool checksum_needed = CHECKSUM_REQUIRED;

static const char* nameOf(Fault fault) {
  switch (fault) {
    case FAULT_RESTARTED:
      return "restarted";
    case FAULT_LINE_LOST:
      return "line_lost";
    case FAULT_NOT_RISING:
      return "not_rising";
    case FAULT_OVER_PRESSURE:
      return "over_pressure";
    case FAULT_SENSOR_LOW:
      return "sensor_low";
    case FAULT_SENSOR_HIGH:
      return "sensor_high";
    default:
      return "none";
  }
}

// "*" and the CRC-16 of a text, four hexadecimal digits: as `checksum: crc16` of the profile.
static void appendChecksum(char* checked) {
  uint16_t crc = 0xFFFF;
  for (; *checked; ++checked) crc = _crc_xmodem_update(crc, (uint8_t)*checked);
  *checked++ = '*';
  for (int8_t shift = 12; shift >= 0; shift -= 4) {
    const uint8_t digit = (uint8_t)(crc >> shift) & 0xF;
    *checked++ = (char)(digit < 10 ? '0' + digit : 'A' + digit - 10);
  }
  *checked = '\0';
}

// Takes the checksum off the line; false if it is wrong, or missing where it is needed.
static bool takeChecksum(void) {
  if (length < CHECKSUM_SIZE || text[length - CHECKSUM_SIZE] != '*') return !checksum_needed;
  char given[CHECKSUM_SIZE + 1];
  strcpy(given, text + length - CHECKSUM_SIZE);
  length -= CHECKSUM_SIZE;
  text[length] = '\0';
  appendChecksum(text);
  const bool same = strcmp(given, text + length) == 0;
  text[length] = '\0';
  checksum_needed = checksum_needed || same;
  return same;
}

// An answer without its end has room for both.
static void say(char* answer) {
  if (checksum_needed) appendChecksum(answer);
  uartSay(strcat(answer, "\n"));
}

static void refuse(void) {
  char out[CHECKSUM_SIZE + 3] = "?";
  say(out);
}

// Not a reading: the host refuses this answer and quotes it in its message.
static void sayFault(uint8_t channel, const char* name) {
  char out[ANSWER_MOST] = "p0=fault ";
  out[1] = (char)('0' + channel);
  say(strcat(out, name));
}

static void sayReading(uint8_t channel) {
  const int32_t pressure_pa = channelPressure(channel);
  const int32_t hundredths = labs(pressure_pa) / 10;
  char out[ANSWER_MOST] = "p0=";
  out[1] = (char)('0' + channel);
  char* end = out + strlen(out);
  if (pressure_pa < 0 && hundredths > 0) *end++ = '-';
  ltoa(hundredths / 100, end, 10);
  end += strlen(end);
  *end++ = '.';
  *end++ = (char)('0' + hundredths / 10 % 10);
  *end++ = (char)('0' + hundredths % 10);
  strcpy(end, " kPa");
  say(out);
}

static void answer(uint8_t channel, Fault least) {
  const Fault fault = channelFault(channel);
  if (fault >= least) {
    sayFault(channel, nameOf(fault));
  } else {
    sayReading(channel);
  }
}

// kPa as digits with at most one point, rounded down; no sign and no exponent.
static bool parsePressure(const char* number, int32_t* pressure_pa) {
  int32_t value = 0;
  uint8_t whole = 0, decimals = 0, digits = 0;
  bool point = false;
  for (; *number; ++number) {
    if (*number == '.' && !point) {
      point = true;
      continue;
    }
    if (*number < '0' || *number > '9') return false;
    ++digits;
    if (!point && ++whole > WHOLE_DIGITS_MOST) return false;
    if (point && ++decimals > DECIMALS) continue;
    value = value * 10 + (*number - '0');
  }
  for (; decimals < DECIMALS; ++decimals) value *= 10;
  *pressure_pa = value;
  return digits > 0;
}

// Carries out the text after "pK=".
static void obey(uint8_t channel, const char* order) {
  int32_t set_point_pa = 0;
  if (strcmp(order, "vent") == 0) {
    channelsHeard();
    channelVent(channel);
    return answer(channel, FAULT_SENSOR_LOW);
  }
  if (strcmp(order, "close") == 0) {
    channelClose(channel);
  } else if (!parsePressure(order, &set_point_pa)) {
    return refuse();
  } else if (set_point_pa > SET_POINT_LIMIT_PA) {
    return sayFault(channel, "above_limit");
  } else {
    channelRegulate(channel, set_point_pa);
  }
  channelsHeard();
  answer(channel, FAULT_RESTARTED);
}

static void takeLine(void) {
  while (length > 0 && (text[length - 1] == ' ' || text[length - 1] == '\r')) --length;
  text[length] = '\0';
  if (!spoilt && length == 0) return;
  const uint8_t channel = (uint8_t)(text[1] - '0');
  if (spoilt || !takeChecksum() || length < 3 || text[0] != 'p' || channel >= CHANNELS) {
    refuse();
  } else if (strcmp(text + 2, "?") == 0) {
    answer(channel, FAULT_SENSOR_LOW);
  } else if (text[2] == '=') {
    obey(channel, text + 3);
  } else {
    refuse();
  }
}

static void clear(void) {
  length = 0;
  spoilt = false;
}

void lineRun(void) {
  uint8_t byte;
  if (!uartTake(&byte)) return;
  gap_ms = 0;
  if (byte == '\n') {
    takeLine();
    clear();
  } else if (length < LINE_MOST && ((byte >= ' ' && byte <= '~') || byte == '\r')) {
    text[length++] = (char)byte;
  } else {
    spoilt = true;
  }
}

void lineTick(void) {
  if (gap_ms < LINE_GAP_MS && ++gap_ms == LINE_GAP_MS) clear();
}
