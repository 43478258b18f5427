#pragma once

#include <optional>
#include <string>

namespace helix_arm::regulator {

/// An app of a device whose slots run one of several apps: one register commands it, another tells
/// its state.
struct ModbusApp {
  int command = 0;             ///< register, counted from the slot's first output
  int regulate = 0;            ///< word: regulate pressures
  int off = 0;                 ///< word: end the app, valves closed
  int acknowledge = 0;         ///< word: acknowledge faults, end the app
  int status = 0;              ///< register, counted from the slot's first input
  int status_mask = 0xffff;    ///< bits of the status that tell the slot's state
  int ready = 0;               ///< value of these bits once acknowledged
  int running = 0;             ///< value of these bits while the slot regulates
  double activation_time = 1;  ///< longest wait for either [s]
};

/// Register map of a device with Modbus TCP. Registers are numbered as on the wire.
///
/// A device has slots with one or more outlets each; an outlet is a pressure channel. A place is
/// the index of an outlet, counted from 0 through all slots.
struct ModbusProfile {
  std::string name;             ///< name of the profile, for messages
  int unit_id = 255;            ///< of the server
  double pascals = 100;         ///< of one count [Pa]; 100: millibar
  double atmosphere = 0;        ///< subtracted from readings, added to set points [Pa]; 0: gauge
  int highest_count = 32767;    ///< largest count that the device accepts; below 0 is never written
  int outlets = 1;              ///< of a slot
  std::optional<int> channels;  ///< outlets of the whole device at most; absent: not known

  int output_base = 0;      ///< first holding register to write
  int output_stride = 1;    ///< registers per slot
  int output_pressure = 0;  ///< set point of the slot's first outlet, counted from its first output
  int input_base = 0;       ///< first register to read
  int input_stride = 1;
  int input_pressure = 0;        ///< reading of the slot's first outlet
  bool input_registers = false;  ///< inputs are read by function 4, otherwise by function 3
  std::optional<int> supply;     ///< register of the supply's pressure; absent: not measured

  std::optional<ModbusApp> app;  ///< absent if slots can only regulate
  double timeout = 0.1;          ///< of one exchange [s]

  /// Highest set point that the device takes, gauge [Pa].
  double highestPressure() const { return highest_count * pascals - atmosphere; }
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

/// Reading of a register whose sensor is broken: the 16-bit number without an opposite. Not a
/// possible pressure.
inline constexpr int kNoReading = 0x8000;

}  // namespace helix_arm::regulator
