#include "plant.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <optional>
#include <system_error>
#include <thread>

#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::simulation {
namespace {

using Clock = std::chrono::steady_clock;
using Milliseconds = std::chrono::milliseconds;
using nlohmann::json;

constexpr Milliseconds kPatience(9'500);                  // for a line; 10 s with what ends it
constexpr Milliseconds kEndPatience(200), kGrace(1'000);  // for how it ended; to end by itself
constexpr Milliseconds kPeriod(5);                        // of looking whether it has ended
constexpr std::size_t kLongestLine = 1U << 20U;
constexpr double kUnitError = 1e-3;                  // of a quaternion's norm
constexpr double kFarthest = 1e3;                    // of a pose from the base [m]
constexpr int kFewestPieces = 12, kMostPieces = 25;  // of a section
constexpr double kSamePlace = 1e-9;
constexpr const char* kRemedy = "; run it alone to see why (protocol: docs/closed_loop.md)";

// Pieces of each section, so that as many tags as possible are at their ends.
int piecesFor(const model::Arm& arm, const std::vector<estimation::TagPlacement>& tags) {
  const int most = std::min(kMostPieces, model::kMaxPieces / arm.sectionCount());
  int best = most;
  std::size_t most_at_ends = 0;
  for (int pieces = std::min(kFewestPieces, most); pieces <= most; ++pieces) {
    std::size_t at_ends = 0;
    for (const estimation::TagPlacement& tag : tags) {
      const double place = tag.s * pieces;
      if (std::abs(place - std::round(place)) < kSamePlace) ++at_ends;
    }
    if (at_ends <= most_at_ends) continue;
    best = pieces;
    most_at_ends = at_ends;
  }
  return best;
}

std::string endOf(const std::optional<int>& status) {
  if (!status) return "closed its output";
  if (WIFSIGNALED(*status)) return std::string("ended with ") + strsignal(WTERMSIG(*status));
  return "ended with exit code " + std::to_string(WEXITSTATUS(*status));
}

std::optional<Eigen::VectorXd> numbersOf(const json& given, Eigen::Index count) {
  if (!given.is_array() || given.size() != static_cast<std::size_t>(count)) return std::nullopt;
  Eigen::VectorXd out(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const json& number = given[static_cast<std::size_t>(i)];
    if (!number.is_number()) return std::nullopt;
    out[i] = number.get<double>();
  }
  return out.allFinite() ? std::optional(out) : std::nullopt;
}

std::optional<lie::SE3> poseOf(const json& given) {
  if (!given.is_object()) return std::nullopt;
  const auto position = numbersOf(given.value("position_m", json()), 3);
  const auto xyzw = numbersOf(given.value("quaternion_xyzw", json()), 4);
  if (!position || !xyzw || position->norm() > kFarthest) return std::nullopt;
  if (std::abs(xyzw->norm() - 1) > kUnitError) return std::nullopt;
  const Eigen::Quaterniond rotation(Eigen::Vector4d(xyzw->normalized()));
  return lie::SE3{rotation.toRotationMatrix(), *position};
}

// Starts it with default signals, and its input and output at the end of a socket.
int spawn(std::vector<std::string> command, int end, pid_t& process) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, end, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, end, STDOUT_FILENO);
#if __GLIBC_PREREQ(2, 34)
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
#endif
  sigset_t all, none;
  sigfillset(&all);
  sigemptyset(&none);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes,
                           POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const int error =
      posix_spawn(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace

// The program, in a process group of its own. Whatever it does, this process goes on.
class Plant::Process {
 public:
  explicit Process(const std::string& command) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
      throw std::system_error(errno, std::generic_category());
    }
    const int error = spawn({"/bin/sh", "-c", command}, ends[1], process_);
    ::close(ends[1]);
    socket_ = ends[0];
    if (error == 0) return;
    ::close(socket_);
    throw std::system_error(error, std::generic_category());
  }
  // Ends its input, waits for it to end, then kills it and all that it started.
  ~Process() {
    ::close(socket_);
    const bool ended = status(kGrace).has_value();
    ::kill(-process_, SIGKILL);
    while (!ended && waitpid(process_, nullptr, 0) < 0 && errno == EINTR) continue;
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // All of a text, or what it reads of it.
  void send(const std::string& text) {
    for (std::size_t sent = 0; sent < text.size();) {
      const ssize_t count = ::send(socket_, text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) return;
      sent += static_cast<std::size_t>(count);
    }
  }

  // Its output until then; empty if its output has ended, nothing if it is silent.
  std::optional<std::string> read(Clock::time_point end) {
    for (;;) {
      const auto left = std::chrono::ceil<Milliseconds>(end - Clock::now()).count();
      pollfd waited{socket_, POLLIN, 0};
      const int ready = left > 0 ? poll(&waited, 1, static_cast<int>(left)) : 0;
      if (ready == 0) return std::nullopt;
      char bytes[4096];
      const ssize_t count = ready < 0 ? -1 : ::read(socket_, bytes, sizeof bytes);
      if (count < 0 && errno == EINTR) continue;
      return std::string(bytes, static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
    }
  }

  // How it ended, as of waitpid(); nothing if it still runs then.
  std::optional<int> status(Milliseconds patience) {
    const auto end = Clock::now() + patience;
    while (!status_) {
      int status = 0;
      const pid_t ended = waitpid(process_, &status, WNOHANG);
      if (ended == process_) {
        status_ = status;
      } else if (ended < 0 || Clock::now() >= end) {
        break;
      } else {
        std::this_thread::sleep_for(kPeriod);
      }
    }
    return status_;
  }

 private:
  pid_t process_ = -1;
  int socket_ = -1;
  std::optional<int> status_;  // once it has ended
};

Plant::Plant(const std::string& command, const model::Arm& arm,
             const std::vector<estimation::TagPlacement>& tags)
    : command_(command),
      arm_(arm),
      pieces_(piecesFor(arm, tags)),
      process_(std::make_unique<Process>(command)) {
  json places = json::array();
  for (int k = 0; k < arm_.sectionCount(); ++k) {
    for (int j = 1; j <= pieces_; ++j) places.push_back({k, static_cast<double>(j) / pieces_});
  }
  const json first{{"protocol", 1},
                   {"actuators", arm_.actuatorNames()},
                   {"sections", arm_.sectionCount()},
                   {"places", places}};
  takePoses(ask(first.dump()), true);
}

void Plant::step(double dt, const Eigen::VectorXd& pressure, const Eigen::Vector3d& tip_force) {
  json turn{{"dt_s", dt}, {"pressure_pa", json::array()}, {"force", nullptr}};
  for (const double one : pressure) turn["pressure_pa"].push_back(one);
  if (!tip_force.isZero(0)) {
    turn["force"] = {{"section", arm_.sectionCount() - 1},
                     {"s", 1.0},
                     {"force_n", {tip_force.x(), tip_force.y(), tip_force.z()}}};
  }
  takePoses(ask(turn.dump()), false);
}

Plant::~Plant() = default;

std::string Plant::ask(const std::string& line) {
  process_->send(line + "\n");  // if it reads no more, it has ended, or is silent
  for (const auto end = Clock::now() + kPatience;;) {
    const auto line_end = received_.find('\n');
    if (line_end != std::string::npos) {
      std::string answer = received_.substr(0, line_end);
      received_.erase(0, line_end + 1);
      return answer;
    }
    if (received_.size() > kLongestLine) refuse("sent a line of more than 1 MB");
    const std::optional<std::string> more = process_->read(end);
    if (!more) refuse("was silent for 10 s");
    if (more->empty()) refuse(endOf(process_->status(kEndPatience)));
    received_ += *more;
  }
}

void Plant::takePoses(const std::string& answer, bool first) {
  const json given = json::parse(answer, nullptr, false);
  const auto broken = [&](const std::string& rule) {
    refuse("answered \"" + basics::quoted(answer, 80) + "\"; expected " + rule);
  };
  if (!given.is_object()) broken("one JSON object in a line");
  if (first && given.value("ready", json()) != true) broken("\"ready\": true in the first line");
  const json poses = given.value("poses", json());
  const int count = arm_.sectionCount() * pieces_;
  if (!poses.is_array() || poses.size() != static_cast<std::size_t>(count)) {
    broken(basics::messageOf("\"poses\" with one pose for each of the ", count, " places"));
  }
  model::Shape::Pieces pieces(6, count);
  lie::SE3 begin;
  for (int j = 0; j < count; ++j) {
    const auto pose = poseOf(poses[static_cast<std::size_t>(j)]);
    if (!pose) {
      broken(basics::messageOf("in pose ", j,
                               " of \"poses\" a position_m of 3 finite numbers "
                               "within 1 km and a quaternion_xyzw of norm 1"));
    }
    const bool tip = j + 1 == count;
    const lie::SE3 link = arm_.link(j / pieces_);
    const lie::SE3 end = tip ? *pose * link.inverse() : *pose;
    pieces.col(j) = (begin.inverse() * end).log();
    begin = (j + 1) % pieces_ == 0 ? end * link : end;
  }
  shape_ = model::Shape(pieces, pieces_, arm_.links());
}

void Plant::refuse(const std::string& fault) const {
  throw PlantError("plant \"" + basics::quoted(command_, 200) + "\" " + fault + kRemedy);
}

}  // namespace helix_arm::simulation
