// Any bytes as what a Modbus device sends: whatever comes, the driver gives readings that are
// numbers or none, or says that they are no good; it never hangs and never reads past its
// registers. Of all inputs together enough must have been talked with at all.
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <mutex>

#include "support/modbus_profiles.hpp"
#include "support/reply_server.hpp"

namespace {

using namespace helix_arm;
using Bytes = test::ReplyServer::Bytes;

constexpr double kTimeout = 0.05;    // far above what an answer takes on a machine that is busy [s]
constexpr double kLongest = 60.0;    // of one call there [s]
constexpr double kLeastShare = 0.1;  // of inputs with a reading
constexpr int kFew = 100;  // inputs, of which no share is asked, as of one that is looked at
constexpr std::uint8_t kWrite = 16;
constexpr int kChannels = 3;

void demand(bool holds) {
  if (!holds) std::abort();
}

// How the inputs have gone; looks at it at the end of the process.
struct Tally {
  int inputs = 0, with_reading = 0;
  ~Tally() {
    if (inputs < kFew || with_reading >= kLeastShare * inputs) return;
    std::fprintf(stderr, "of %d inputs only %d led to a reading; expected a share of %g\n", inputs,
                 with_reading, kLeastShare);
    std::abort();
  }
};

// What the server says: to one request in two it keeps to the protocol up to the fuzzed part, so
// that the bytes get past the header. What is broken is mostly its last word, so that few wait for
// the rest until their timeout.
class Script {
 public:
  void begin(const std::uint8_t* bytes, std::size_t size) {
    const std::lock_guard<std::mutex> lock(mutex_);
    bytes_.assign(bytes, bytes + size);
    at_ = 0;
  }
  test::ReplyServer::Reply answer(const Bytes& request) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (request.size() < 12) return {Bytes(), true};
    const std::uint8_t mode = next();
    Bytes reply(request.begin(), request.begin() + 8);
    switch (mode % 4) {
      case 0:  // the header of the request, then anything
        append(next() % 64, reply);
        reply[5] = static_cast<std::uint8_t>(reply.size() - 6);
        break;
      case 1:  // anything
        reply.clear();
        append(next() % 64, reply);
        break;
      default:  // as it should be, with any registers
        if (request[7] == kWrite) {
          reply.insert(reply.end(), request.begin() + 8, request.begin() + 12);
        } else {
          const int size = 2 * (request[10] << 8 | request[11]);
          reply.push_back(static_cast<std::uint8_t>(size));
          append(size, reply);
        }
        reply[5] = static_cast<std::uint8_t>(reply.size() - 6);
    }
    return {reply, mode % 4 < 2 && mode < kWaits};
  }

 private:
  static constexpr std::uint8_t kWaits = 248;

  std::uint8_t next() { return at_ < bytes_.size() ? bytes_[at_++] : std::uint8_t{2}; }
  void append(int count, Bytes& reply) {
    for (int i = 0; i < count; ++i) reply.push_back(next());
  }

  std::mutex mutex_;
  Bytes bytes_;
  std::size_t at_ = 0;
};

// Done, or one of the two errors that a driver may have; and in time. True when done.
bool call(const std::function<void()>& call) {
  bool done = false;
  const auto begin = std::chrono::steady_clock::now();
  try {
    call();
    done = true;
  } catch (const regulator::BadReply& error) {
    demand(*error.what() != '\0');
  } catch (const regulator::LinkError& error) {
    demand(*error.what() != '\0');
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  demand(took.count() < kLongest);
  return done;
}

std::unique_ptr<regulator::Driver> driverOf(regulator::ModbusProfile profile, int port) {
  profile.timeout = kTimeout;
  if (profile.app) profile.app->activation_time = 0.01;
  return regulator::ModbusConfig{profile, "127.0.0.1", port, {0, 1, 2}}.makeDriver(kChannels);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static Script script;
  static test::ReplyServer server([](const Bytes& request) { return script.answer(request); });
  static const auto mpa = driverOf(test::mpaProfile(), server.port());
  static const auto vtem = driverOf(test::vtemProfile(), server.port());
  static Tally tally;
  if (size == 0) return 0;
  script.begin(bytes + 1, size - 1);
  const auto& driver = bytes[0] % 8 == 0 ? vtem : mpa;
  call([&driver] { driver->connect(); });
  bool read = false;
  for (int i = 0; i < 3; ++i) {
    read |= call([&driver] {
      regulator::Pressures pressures(kChannels);
      driver->read(pressures);
      for (const double pressure : pressures.pressure) {
        demand(std::isnan(pressure) || (pressure > -1.1e5 && pressure <= 32767 * 100.0));
      }
    });
    call([&driver] { driver->vent(); });
  }
  driver->close();
  ++tally.inputs;
  tally.with_reading += read ? 1 : 0;
  return 0;
}
