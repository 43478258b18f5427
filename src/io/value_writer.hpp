#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "document.hpp"

namespace helix_arm::io {

/// A value that is written unquoted: a number, true, a word.
Value plainValue(const std::string& text);
/// The shortest text that reads back as the same number.
Value numberValue(double number);
Value numbersValue(const Eigen::VectorXd& numbers);
Value listValue(const std::vector<Value>& values);

/// The mutable value of a map's key, null if there is none.
Value* findValue(Value& map, const std::string& key);
/// Replaces the value of a key, or appends the key.
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
  /// Quoted, so that it is read back as text.
  void text(const std::string& key, const std::string& text);
  void list(const std::string& key, const std::vector<Value>& values) {
    set(key, listValue(values));
  }
  const Value& value() const { return map_; }

 private:
  Value map_;
};

}  // namespace helix_arm::io
