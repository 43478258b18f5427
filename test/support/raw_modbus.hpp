#pragma once

#include <cerrno>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <vector>

#include "modbus/modbus.h"

namespace helix_arm::test {

/// A bare client of a Modbus server on 127.0.0.1: registers as they are on the wire.
class RawModbus {
 public:
  using Words = std::vector<std::uint16_t>;

  explicit RawModbus(int port) : context_(modbus_new_tcp("127.0.0.1", port), modbus_free) {
    modbus_set_response_timeout(context_.get(), 5, 0);
    if (modbus_connect(context_.get()) != 0) throw std::runtime_error(modbus_strerror(errno));
  }
  ~RawModbus() { modbus_close(context_.get()); }
  RawModbus(const RawModbus&) = delete;
  RawModbus& operator=(const RawModbus&) = delete;

  /// Holding registers; empty where they are refused.
  Words read(int first, int count) const {
    Words words(static_cast<std::size_t>(count));
    if (modbus_read_registers(context_.get(), first, count, words.data()) != count) return {};
    return words;
  }
  Words readInputs(int first, int count) const {
    Words words(static_cast<std::size_t>(count));
    if (modbus_read_input_registers(context_.get(), first, count, words.data()) != count) return {};
    return words;
  }
  bool write(int first, const Words& words) const {
    const auto count = static_cast<int>(words.size());
    return modbus_write_registers(context_.get(), first, count, words.data()) == count;
  }
  /// Sends the order to write a holding register, and does not wait for an answer.
  bool order(int register_number, std::uint16_t word) const {
    const auto high = [](int number) { return static_cast<std::uint8_t>(number >> 8); };
    const auto low = [](int number) { return static_cast<std::uint8_t>(number); };
    const std::uint8_t request[] = {MODBUS_TCP_SLAVE,
                                    MODBUS_FC_WRITE_SINGLE_REGISTER,
                                    high(register_number),
                                    low(register_number),
                                    high(word),
                                    low(word)};
    return modbus_send_raw_request(context_.get(), request, sizeof request) > 0;
  }

 private:
  std::unique_ptr<modbus_t, void (*)(modbus_t*)> context_;
};

}  // namespace helix_arm::test
