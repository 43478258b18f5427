#include "log.hpp"

#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <sstream>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace levels = ros::console::levels;

// More than the faults that a scene may report at once (io::FaultList::kMostKept).
constexpr std::size_t kMostWaiting = 200;

struct Current {
  basics::Mutex mutex;
  LogThread* thread HELIX_ARM_GUARDED_BY(mutex) = nullptr;
};

Current& current() {
  static Current instance;
  return instance;
}

void writeNow(LogLevel level, const std::string& line) {
  ROS_LOG(level, ROSCONSOLE_DEFAULT_NAME, "%s", line.c_str());
}

// False without a LogThread.
bool queued(LogLevel level, const std::string& line) {
  Current& to = current();
  const basics::MutexLock lock(to.mutex);
  if (to.thread != nullptr) to.thread->write(level, line);
  return to.thread != nullptr;
}

void hand(LogLevel level, const char* format, std::va_list values) {
  std::va_list again;
  va_copy(again, values);
  const int length = std::vsnprintf(nullptr, 0, format, again);
  va_end(again);
  if (length < 0) return;
  std::string line(static_cast<std::size_t>(length) + 1, '\0');
  std::vsnprintf(line.data(), line.size(), format, values);
  line.pop_back();
  std::istringstream lines(basics::printableLines(line));
  while (std::getline(lines, line)) {
    if (!queued(level, line)) writeNow(level, line);
  }
}

}  // namespace

// With an ellipsis, arguments are passed on as a va_list only.
#define HELIX_ARM_LOG(function, level)     \
  void function(const char* format, ...) { \
    std::va_list values;                   \
    va_start(values, format);              \
    hand(level, format, values);           \
    va_end(values);                        \
  }
HELIX_ARM_LOG(logInfo, levels::Info)
HELIX_ARM_LOG(logWarning, levels::Warn)
HELIX_ARM_LOG(logError, levels::Error)
HELIX_ARM_LOG(logFatal, levels::Fatal)
#undef HELIX_ARM_LOG

void logLine(LogLevel level, const char* format, ...) {
  std::va_list values;
  va_start(values, format);
  hand(level, format, values);
  va_end(values);
}

LogThread::LogThread() : thread_([this] { run(); }) {
  Current& to = current();
  const basics::MutexLock lock(to.mutex);
  to.thread = this;
}

LogThread::~LogThread() {
  {
    Current& to = current();
    const basics::MutexLock lock(to.mutex);
    to.thread = nullptr;
  }
  {
    const basics::MutexLock lock(mutex_);
    ended_ = true;
  }
  changed_.notifyAll();
  thread_.join();
}

void LogThread::write(LogLevel level, std::string line) {
  {
    const basics::MutexLock lock(mutex_);
    if (waiting_.size() < kMostWaiting) {
      waiting_.emplace_back(level, std::move(line));
    } else {
      ++lost_;
    }
  }
  changed_.notifyAll();
}

bool LogThread::flush(double longest) {
  basics::MutexLock lock(mutex_);
  return changed_.waitFor(lock, std::chrono::duration<double>(longest),
                          [this]()
                              HELIX_ARM_REQUIRES(mutex_) { return waiting_.empty() && !writing_; });
}

void LogThread::run() {
  basics::MutexLock lock(mutex_);
  while (!ended_ || !waiting_.empty()) {
    changed_.wait(lock,
                  [this]() HELIX_ARM_REQUIRES(mutex_) { return ended_ || !waiting_.empty(); });
    decltype(waiting_) lines;
    lines.swap(waiting_);
    const std::uint64_t lost = std::exchange(lost_, 0);
    writing_ = true;
    lock.unlock();
    for (const auto& [level, line] : lines) writeNow(level, line);
    if (lost > 0) {
      writeNow(levels::Warn, std::to_string(lost) + " lines are missing here: the log was blocked");
    }
    lock.lock();
    writing_ = false;
    changed_.notifyAll();
  }
}

}  // namespace helix_arm::ros_bridge
