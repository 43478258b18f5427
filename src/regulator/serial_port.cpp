#include "serial_port.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "line_format.hpp"
#include "regulator_io.hpp"

namespace helix_arm::regulator {
namespace {

constexpr double kLastWords = 0.2;  // [s]
constexpr const char* kUnplugged =
    "hung up: it was unplugged or switched off; check its cable and power";

std::string openingFault(int error) {
  switch (error) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      return "does not exist; plug it in, or use a name that `ls /dev/serial/by-id` lists";
    case EACCES:
    case EPERM:
      return "cannot be opened without permission; add yourself to the group dialout (sudo usermod "
             "-aG dialout $USER) and log in again";
    case EBUSY:
      return "is used by another program; end that one (fuser shows which it is)";
    case EISDIR:
      return "is a folder; expected a serial line such as /dev/ttyUSB0";
    default:
      return std::string("cannot be opened: ") + std::strerror(error);
  }
}

struct Rate {
  int baud;
  speed_t speed;
};
constexpr Rate kRates[] = {{1200, B1200},       {2400, B2400},      {4800, B4800},
                           {9600, B9600},       {19200, B19200},    {38400, B38400},
                           {57600, B57600},     {115200, B115200},  {230400, B230400},
                           {460800, B460800},   {500000, B500000},  {921600, B921600},
                           {1000000, B1000000}, {2000000, B2000000}};

const Rate* rateOf(int baud) {
  const auto known = std::find_if(std::begin(kRates), std::end(kRates),
                                  [baud](const Rate& rate) { return rate.baud == baud; });
  return known == std::end(kRates) ? nullptr : known;
}

// An exclusive pseudo terminal would stay so if its holder is killed: no guard could open it.
bool isPseudoTerminal(int file) {
  constexpr unsigned kFirstMajor = 136, kLastMajor = 143;  // of Linux
  struct stat status {};
  if (fstat(file, &status) != 0) return false;
  const unsigned number = major(status.st_rdev);
  return number >= kFirstMajor && number <= kLastMajor;
}

// Rounded up: poll() with 0 ms before the deadline would spin.
int millisecondsTo(double deadline) {
  return static_cast<int>(std::ceil(1e3 * std::clamp(deadline - steadyNow(), 0.0, 60.0)));
}

}  // namespace

bool isStandardBaud(int baud) { return rateOf(baud) != nullptr; }

SerialPort::~SerialPort() { close(); }

void SerialPort::fail(const std::string& cause) const {
  throw LinkError(basics::quoted(device_, 256) + " " + cause);
}

void SerialPort::open(const std::string& device, int baud) {
  close();
  const Rate* const rate = rateOf(baud);
  basics::require(rate != nullptr, "serial port: baud is ", baud,
                  "; expected a standard rate such as 115200");
  device_ = device;
  file_ = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (file_ < 0) fail(openingFault(errno));
  termios settings{};
  if (tcgetattr(file_, &settings) != 0) {
    close();
    fail("is not a serial line; expected one such as /dev/ttyUSB0");
  }
  claim();
  cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD;
  // With HUPCL off, a board that resets when the line drops keeps running between programs.
  settings.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | PARENB | CRTSCTS | HUPCL);
  settings.c_iflag &= ~static_cast<tcflag_t>(IXOFF | IXANY);
  settings.c_cc[VMIN] = 0;
  settings.c_cc[VTIME] = 0;
  if (cfsetspeed(&settings, rate->speed) != 0 || tcsetattr(file_, TCSANOW, &settings) != 0) {
    const int error = errno;
    close();
    fail("does not support " + std::to_string(baud) + " baud: " + std::strerror(error));
  }
}

void SerialPort::claim() {
  if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    // Not close(): line and buffers belong to another process.
    ::close(file_);
    file_ = -1;
    fail(openingFault(error == EWOULDBLOCK ? EBUSY : error));
  }
  if (!isPseudoTerminal(file_)) ioctl(file_, TIOCEXCL);  // not supported by every device
}

void SerialPort::close() noexcept {
  if (file_ < 0) return;
  ioctl(file_, TIOCNXCL);
  awaitSent();
  tcflush(file_, TCOFLUSH);  // otherwise close() waits for a device that accepts nothing
  flock(file_, LOCK_UN);     // a process that is just being forked has the file open, too
  ::close(file_);
  file_ = -1;
  input_.clear();
}

// The last line may be a vent.
void SerialPort::awaitSent() const noexcept {
  const double end = steadyNow() + kLastWords;
  int waiting = 0;
  while (ioctl(file_, TIOCOUTQ, &waiting) == 0 && waiting > 0 && steadyNow() < end) {
    poll(nullptr, 0, 1);
  }
}

bool SerialPort::awaitInput(double deadline) const {
  pollfd line{file_, POLLIN, 0};
  const int ready = poll(&line, 1, millisecondsTo(deadline));
  if (ready < 0 && errno != EINTR) fail(std::string("cannot be polled: ") + std::strerror(errno));
  if (ready <= 0) return false;
  if ((line.revents & POLLIN) == 0) fail(kUnplugged);
  return true;
}

std::size_t SerialPort::takeInput() {
  char bytes[256];
  const ssize_t count = ::read(file_, bytes, sizeof bytes);
  if (count > 0) {
    input_.append(bytes, static_cast<std::size_t>(count));
    return static_cast<std::size_t>(count);
  }
  if (count < 0 && (errno == EAGAIN || errno == EINTR)) return 0;
  if (count == 0 || errno == EIO || errno == ENXIO || errno == ENODEV) fail(kUnplugged);
  fail(std::string("cannot be read: ") + std::strerror(errno));
}

bool SerialPort::discardInput() {
  bool any = !input_.empty();
  if (file_ < 0) fail("is not open");
  // A device that never stops sending exceeds the longest line, which is refused below.
  for (std::size_t taken = 0; taken < 16 * kLongestLine && awaitInput(0);) {
    const std::size_t count = takeInput();
    if (count == 0) break;
    taken += count;
    any = true;
    input_.clear();
  }
  input_.clear();
  return any;
}

void SerialPort::send(const std::string& bytes, double deadline) {
  if (file_ < 0) fail("is not open");
  for (std::size_t sent = 0; sent < bytes.size();) {
    const ssize_t count = ::write(file_, bytes.data() + sent, bytes.size() - sent);
    if (count > 0) {
      sent += static_cast<std::size_t>(count);
      continue;
    }
    if (count < 0 && errno != EAGAIN && errno != EINTR) {
      fail(errno == EIO || errno == ENXIO || errno == ENODEV
               ? kUnplugged
               : std::string("cannot be written: ") + std::strerror(errno));
    }
    pollfd line{file_, POLLOUT, 0};
    const int ready = poll(&line, 1, millisecondsTo(deadline));
    if (ready > 0 && (line.revents & POLLOUT) == 0) fail(kUnplugged);
    if (ready <= 0 && steadyNow() >= deadline) {
      fail("accepts no more lines; check its cable, and that it is switched on");
    }
  }
}

std::optional<std::string> SerialPort::receiveLine(const std::string& terminator, double deadline) {
  if (file_ < 0) fail("is not open");
  for (;;) {
    const std::size_t end = input_.find(terminator);
    if (end != std::string::npos && end <= kLongestLine) {
      std::string line = input_.substr(0, end);
      input_.erase(0, end + terminator.size());
      return line;
    }
    if (input_.size() > kLongestLine) {
      const std::string begin = basics::quoted(input_, 32);
      input_.clear();
      throw BadReply(device_ + " sent a line of more than " + std::to_string(kLongestLine) +
                     " bytes: \"" + begin + "\"");
    }
    if (awaitInput(deadline)) {
      takeInput();
    } else if (steadyNow() >= deadline) {
      return std::nullopt;
    }
  }
}

}  // namespace helix_arm::regulator
