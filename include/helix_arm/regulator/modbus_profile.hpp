#pragma once

#include <optional>
#include <string>

namespace helix_arm::regulator {

/// What a slot runs, in a device whose slots run one of several apps: a word to command it, a word
/// that tells what it does.
struct ModbusApp {
  int command = 0;             ///< register, counted from the slot's first output
  int regulate = 0;            ///< word: regulate pressures
  int off = 0;                 ///< word: end the app, valves closed
  int acknowledge = 0;         ///< word: acknowledge faults, end the app
  int status = 0;              ///< register, counted from the slot's first input
  int status_mask = 0xffff;    ///< bits of it that tell what the slot does
  int ready = 0;               ///< they read so once acknowledged
  int running = 0;             ///< and so while the slot regulates
  double activation_time = 1;  ///< longest wait for either [s]
};

/// Where a device that speaks Modbus TCP has its pressures. Registers are numbered as they are on
/// the wire.
///
/// A device has slots, each of them one or more outlets, a pressure channel each. Places are its
/// outlets, counted from 0 through all slots.
struct ModbusProfile {
  std::string name;           ///< of the profile, for messages
  int unit_id = 255;          ///< of the server
  double pascals = 100;       ///< of one count [Pa]; 100: millibar
  double atmosphere = 0;      ///< subtracted from readings, added to set points [Pa]; 0: gauge
  int highest_count = 32767;  ///< that the device takes; below 0 is never written
  int outlets = 1;            ///< of a slot

  int output_base = 0;      ///< first holding register to write
  int output_stride = 1;    ///< registers a slot
  int output_pressure = 0;  ///< set point of the slot's first outlet, counted from its first output
  int input_base = 0;       ///< first register to read
  int input_stride = 1;
  int input_pressure = 0;        ///< reading of the slot's first outlet
  bool input_registers = false;  ///< inputs are read by function 4; else by function 3
  std::optional<int> supply;     ///< register of the supply's pressure; absent: not measured

  std::optional<ModbusApp> app;  ///< absent: slots do nothing but regulate
  double timeout = 0.1;          ///< of one exchange [s]

  /// Slot of a place.
  int slot(int place) const { return place / outlets; }
  /// Register of a place's set point.
  int setPoint(int place) const {
    return output_base + output_stride * slot(place) + output_pressure + place % outlets;
  }
  /// Register of a place's reading.
  int reading(int place) const {
    return input_base + input_stride * slot(place) + input_pressure + place % outlets;
  }
  /// Registers of a slot's app. Only with an app.
  int command(int slot) const { return output_base + output_stride * slot + app->command; }
  int status(int slot) const { return input_base + input_stride * slot + app->status; }

  /// @throws std::invalid_argument naming the key and its rule.
  void validate() const;
};

/// What a register reads whose sensor is broken: the 16-bit number that has no opposite. No
/// pressure that can be.
inline constexpr int kNoReading = 0x8000;

}  // namespace helix_arm::regulator
