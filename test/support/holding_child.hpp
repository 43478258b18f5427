#pragma once

#include <csignal>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

namespace helix_arm::test {

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
