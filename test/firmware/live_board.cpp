#include "live_board.hpp"

#include <chrono>
#include <utility>

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

namespace helix_arm::test {
namespace {

constexpr double kStep = 0.0005;          // [s]
constexpr double kAnswerTime = 0.005;     // after the last byte either way [s]
constexpr int kUnopenedMilliseconds = 2;  // between looks whether somebody has come

}  // namespace

LiveBoard::LiveBoard(const BoardKind& kind)
    : link_(folder_ / "board"),
      terminal_(std::in_place),
      board_(kind),
      wake_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  link_.pointTo(terminal_->path());
  thread_ = std::thread([this] { run(); });
}

LiveBoard::~LiveBoard() {
  ended_ = true;
  wake();
  thread_.join();
  ::close(wake_);
}

void LiveBoard::wake() const { eventfd_write(wake_, 1); }

void LiveBoard::pass(double dt) {
  basics::MutexLock lock(mutex_);
  const double end = board_.time() + dt;
  granted_ = end;
  wake();
  passed_.wait(lock, [&]() HELIX_ARM_REQUIRES(mutex_) { return board_.time() >= end; });
}

double LiveBoard::time() {
  return with([](const SimulatedBoard& board) { return board.time(); });
}

void LiveBoard::damage(Damage damage) {
  const basics::MutexLock lock(mutex_);
  damage_ = std::move(damage);
}

void LiveBoard::damageAnswers(Damage damage) {
  const basics::MutexLock lock(mutex_);
  answer_damage_ = std::move(damage);
}

void LiveBoard::unplug() {
  const basics::MutexLock lock(mutex_);
  unplugged_ = true;
  wake();
}

void LiveBoard::answer(const std::string& bytes) {
  if (!answer_damage_) return terminal_->send(std::exchange(answer_, {}) + bytes);
  answer_ += bytes;
  for (std::size_t end = answer_.find('\n'); end != std::string::npos; end = answer_.find('\n')) {
    terminal_->send(answer_damage_(answer_.substr(0, end + 1)));
    answer_.erase(0, end + 1);
  }
}

// Whether there was anything to do.
bool LiveBoard::step() {
  const std::optional<std::string> bytes = terminal_->receive();
  const basics::MutexLock lock(mutex_);
  if (std::exchange(unplugged_, false)) {
    terminal_.emplace();
    link_.pointTo(terminal_->path());
    board_.chip().reset(SimulatedChip::Reset::kPowerOn);
    board_.receive();
    return true;
  }
  if (bytes && !bytes->empty()) board_.send(damage_ ? damage_(*bytes) : *bytes);
  if (board_.isReceiving()) quiet_from_ = board_.time() + kAnswerTime;
  if (board_.time() >= granted_ && board_.time() >= quiet_from_) return false;
  board_.advance(kStep);
  const std::string sent = board_.receive();
  if (!sent.empty()) {
    quiet_from_ = board_.time() + kAnswerTime;
    answer(sent);
  }
  if (board_.time() >= granted_) passed_.notifyAll();
  return true;
}

void LiveBoard::run() {
  while (!ended_) {
    if (step()) continue;
    pollfd files[2] = {{wake_, POLLIN, 0}, {terminal_->file(), POLLIN, 0}};
    poll(files, 2, -1);
    // While nobody has opened it, the terminal is ready all the time.
    if ((files[1].revents & POLLHUP) != 0) poll(files, 1, kUnopenedMilliseconds);
    eventfd_t count = 0;
    eventfd_read(wake_, &count);
  }
}

}  // namespace helix_arm::test
