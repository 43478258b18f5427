#include "line_damage.hpp"

#include <map>
#include <random>
#include <regex>
#include <string>
#include <utility>

namespace helix_arm::test {
namespace {

char randomByte(std::mt19937& generator) {
  return static_cast<char>(std::uniform_int_distribution<int>(0, 255)(generator));
}

}  // namespace

LiveBoard::Damage cut() {
  return [](const std::string&) { return std::string(); };
}

LiveBoard::Damage halved() {
  return [](const std::string& bytes) { return bytes.substr(0, bytes.size() / 2); };
}

LiveBoard::Damage noisy() {
  return [generator = std::mt19937(5)](const std::string& bytes) mutable {
    std::string out;
    for (const char sent : bytes) {
      out += sent;
      if (std::bernoulli_distribution(0.25)(generator)) out += randomByte(generator);
    }
    return out;
  };
}

LiveBoard::Damage garbage() {
  return [generator = std::mt19937(6)](const std::string& bytes) mutable {
    std::string out(bytes.size(), '\0');
    for (char& byte : out) byte = randomByte(generator);
    return out + "\n";
  };
}

LiveBoard::Damage flooded() {
  return [](const std::string& bytes) {
    std::string out;
    for (int i = 0; i < 100; ++i) out += "xyzzy?\n";
    return out + bytes;
  };
}

LiveBoard::Damage late() {
  return [waiting = std::string()](const std::string& line) mutable {
    return std::exchange(waiting, line);
  };
}

LiveBoard::Damage inPsi() {
  return [](const std::string& line) { return std::regex_replace(line, std::regex("kPa"), "psi"); };
}

LiveBoard::Damage notANumber() {
  return [](const std::string& line) {
    return std::regex_replace(line, std::regex("=-?[0-9.]+ "), "=nan ");
  };
}

LiveBoard::Damage stuck() {
  return [first = std::map<std::string, std::string>()](const std::string& line) mutable {
    return first.try_emplace(line.substr(0, line.find('=')), line).first->second;
  };
}

}  // namespace helix_arm::test
