#include "diagnostics.hpp"

#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <sstream>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "guarded_callbacks.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace levels = ros::console::levels;

// More than the faults that a scene may report at once (io::FaultList::kMostKept).
constexpr std::size_t kMostWaiting = 200;

// Longest time in which all nodes of an arm are reloaded, one after the other [s].
constexpr double kReloadTime = 3.0;

struct Current {
  basics::Mutex mutex;
  LogThread* thread HELIX_ARM_GUARDED_BY(mutex) = nullptr;

  void set(LogThread* next) HELIX_ARM_EXCLUDES(mutex) {
    const basics::MutexLock lock(mutex);
    thread = next;
  }
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

constexpr double kWarningPeriod = 5.0;  // of each kind of fault [s]

}  // namespace

// With an ellipsis, arguments are passed on as a va_list only.
#define HELIX_ARM_LOG(level, function, ...) \
  void function(__VA_ARGS__) {              \
    std::va_list values;                    \
    va_start(values, format);               \
    hand(level, format, values);            \
    va_end(values);                         \
  }
HELIX_ARM_LOG(levels::Info, logInfo, const char* format, ...)
HELIX_ARM_LOG(levels::Warn, logWarning, const char* format, ...)
HELIX_ARM_LOG(levels::Error, logError, const char* format, ...)
HELIX_ARM_LOG(levels::Fatal, logFatal, const char* format, ...)
HELIX_ARM_LOG(level, logLine, LogLevel level, const char* format, ...)
#undef HELIX_ARM_LOG

LogThread::LogThread() : thread_([this] { run(); }) { current().set(this); }

LogThread::~LogThread() {
  current().set(nullptr);
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

std::string statusName(const std::string& node, const std::string& what) {
  return node.substr(node.compare(0, 1, "/") == 0 ? 1 : 0) + ": " + what;
}

void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value) {
  diagnostic_msgs::KeyValue entry;
  entry.key = key;
  entry.value = value;
  status.values.push_back(entry);
}

diagnostic_msgs::DiagnosticStatus makeStatus(
    const std::string& what, unsigned char level, const std::string& message,
    const std::vector<std::pair<std::string, std::string>>& values) {
  diagnostic_msgs::DiagnosticStatus out;
  out.name = what;
  out.level = level;
  out.message = message;
  for (const auto& [key, value] : values) addValue(out, key, value);
  return out;
}

DiagnosticsPublisher::DiagnosticsPublisher(ros::NodeHandle& node)
    : publisher_(node.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)) {
  for (const char* name :
       {names::kPressureCommandNode, names::kVisionNode, names::kVisualServoNode}) {
    peers_.push_back({statusName(node.resolveName(name), ""), "", "", {}, {}});
  }
  subscriber_ = listen(node, names::kDiagnostics, 50, &DiagnosticsPublisher::onDiagnostics, this);
}

void DiagnosticsPublisher::publish(const std::string& node, const io::Scene& scene,
                                   std::vector<diagnostic_msgs::DiagnosticStatus> statuses) {
  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status = std::move(statuses);
  for (auto& status : msg.status) {
    status.name = statusName(node, status.name);
    status.hardware_id = scene.name;
  }
  addValue(msg.status.front(), names::kSceneKey, scene.sha256);
  if (const std::string other = otherScene(scene); !other.empty()) {
    msg.status.front().level = diagnostic_msgs::DiagnosticStatus::ERROR;
    msg.status.front().message = other;
  }
  publisher_.publish(msg);
}

std::string DiagnosticsPublisher::otherScene(const io::Scene& scene) {
  const ros::SteadyTime now = ros::SteadyTime::now();
  std::string out;
  for (Peer& peer : peers_) {
    const bool heard = now - peer.heard < ros::WallDuration(kReloadTime);
    if (!heard || peer.sha256 == scene.sha256) {
      peer.differs_since = {};
    } else if (peer.differs_since.isZero()) {
      peer.differs_since = now;
    } else if (now - peer.differs_since > ros::WallDuration(kReloadTime)) {
      out =
          peer.prefix + "its scene " + basics::quoted(peer.scene, kLongestMessage) +
          " is another file than the scene " + scene.name +
          " of this node; call ~reload of pressure_command, vision and visual_servo with one file";
    }
  }
  return out;
}

void DiagnosticsPublisher::onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
  for (const auto& status : message->status) {
    const std::string sha256 = valueOf(status, names::kSceneKey);
    for (Peer& peer : peers_) {
      if (sha256.empty() || status.name.compare(0, peer.prefix.size(), peer.prefix) != 0) continue;
      peer.scene = status.hardware_id;
      peer.sha256 = sha256;
      peer.heard = ros::SteadyTime::now();
    }
  }
}

std::string valueOf(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return entry.value;
  }
  return "";
}

std::string fixed(double value, int decimals) { return basics::format("%.*f", decimals, value); }

bool FaultCount::add() {
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (total_++ > 0 && now - last_warning_ < ros::WallDuration(kWarningPeriod)) return false;
  last_warning_ = now;
  return true;
}

FaultGuard::FaultGuard(std::string source, Log log)
    : source_(std::move(source)),
      log_(log ? std::move(log) : [](const std::string& line) { logWarning("%s", line.c_str()); }) {
}

void FaultGuard::caught(const std::string& culprit, const char* fault, std::string* why) noexcept {
  try {
    const std::string text = basics::printableLines(fault);
    if (why != nullptr) *why = text;
    const basics::MutexLock lock(mutex_);
    if (!faults_.add()) return;
    log_(source_ + (culprit.empty() ? "" : " from " + culprit) + " was dropped (" +
         std::to_string(faults_.total()) + " so far): " + text);
  } catch (...) {  // out of memory: the next warning has the count
  }
}

}  // namespace helix_arm::ros_bridge
