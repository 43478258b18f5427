#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "document.hpp"

namespace helix_arm::io {

/// A value that is written as it stands: a number, true, a word.
Value plainValue(const std::string& text);
/// The shortest text that reads back as the same number.
Value numberValue(double number);
Value numbersValue(const Eigen::VectorXd& numbers);
Value listValue(const std::vector<Value>& values);

/// The value of a map's key, null when there is none, to be changed.
Value* findValue(Value& map, const std::string& key);
/// Puts a value in the place of a key's, or at the end.
void setValue(Value& map, const std::string& key, Value value);
void eraseValue(Value& map, const std::string& key);

/// Builds a map key by key.
class MapWriter {
 public:
  MapWriter() { map_.kind = Value::Kind::kMap; }
  void set(const std::string& key, Value value) { setValue(map_, key, std::move(value)); }
  void number(const std::string& key, double number) { set(key, numberValue(number)); }
  void numbers(const std::string& key, const Eigen::VectorXd& numbers) {
    set(key, numbersValue(numbers));
  }
  void word(const std::string& key, const std::string& word) { set(key, plainValue(word)); }
  /// Whatever it looks like, it stays a text.
  void text(const std::string& key, const std::string& text);
  void list(const std::string& key, const std::vector<Value>& values) {
    set(key, listValue(values));
  }
  const Value& value() const { return map_; }

 private:
  Value map_;
};

}  // namespace helix_arm::io
