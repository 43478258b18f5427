#pragma once

#include <csignal>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace helix_arm::test {

/// What a child process said and what it took.
struct ChildRun {
  std::string text;        ///< what `body` returned; empty where it did not come so far
  int signal = 0;          ///< that ended it; 0: none
  double megabytes = 0.0;  ///< most memory it held at a time, more than it was born with
};

/// Runs something in a child process, whose memory can be measured separately. No other thread may
/// run.
inline ChildRun runInChild(const std::function<std::string()>& body) {
  int ends[2];
  ChildRun run;
  if (pipe(ends) != 0) return run;
  const auto peak = [](int who) {
    rusage usage{};
    getrusage(who, &usage);
    return static_cast<double>(usage.ru_maxrss) / 1024;
  };
  const pid_t child = fork();
  if (child == 0) {
    // The peak is inherited: what the child takes is counted from where it begins.
    const double before = peak(RUSAGE_SELF);
    std::string text;
    try {
      text = body();
    } catch (const std::exception& error) {
      text = error.what();
    }
    text = std::to_string(peak(RUSAGE_SELF) - before) + "\n" + text;
    for (std::size_t done = 0; done < text.size();) {
      const ssize_t count = write(ends[1], text.data() + done, text.size() - done);
      if (count <= 0) break;
      done += static_cast<std::size_t>(count);
    }
    _exit(0);
  }
  close(ends[1]);
  char block[4096];
  for (ssize_t count; (count = read(ends[0], block, sizeof block)) > 0;) {
    run.text.append(block, static_cast<std::size_t>(count));
  }
  close(ends[0]);
  int status = 0;
  waitpid(child, &status, 0);
  if (WIFSIGNALED(status)) run.signal = WTERMSIG(status);
  const std::size_t line = run.text.find('\n');
  if (line == std::string::npos) return run;
  run.megabytes = std::stod(run.text.substr(0, line));
  run.text.erase(0, line + 1);
  return run;
}

/// A child process that says a line and stays until it is killed, with what it holds.
class HoldingChild {
 public:
  explicit HoldingChild(const std::function<std::string()>& say) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    id_ = fork();
    if (id_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      const std::string text = say() + "\n";
      if (write(ends[1], text.data(), text.size()) < 0) _exit(1);
      for (;;) pause();
    }
    close(ends[1]);
    char byte = 0;
    while (read(ends[0], &byte, 1) == 1 && byte != '\n') text_ += byte;
    close(ends[0]);
    if (byte != '\n') text_ = "it could not try";
  }
  ~HoldingChild() { kill(); }
  HoldingChild(const HoldingChild&) = delete;
  HoldingChild& operator=(const HoldingChild&) = delete;

  void kill() {
    if (id_ <= 0) return;
    ::kill(id_, SIGKILL);
    waitpid(std::exchange(id_, -1), nullptr, 0);
  }
  const std::string& text() const { return text_; }
  pid_t id() const { return id_; }

 private:
  pid_t id_ = -1;
  std::string text_;
};

}  // namespace helix_arm::test
