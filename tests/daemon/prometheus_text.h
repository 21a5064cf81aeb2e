// Reads the Prometheus exposition format 0.0.4, strictly: for the tests.
#pragma once

#include <cctype>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace servotwin::daemon {

struct PrometheusSample {
  std::string name;
  std::map<std::string, std::string> labels;
  double value = 0.0;
};

struct PrometheusFamily {
  std::string type, help;
  std::vector<PrometheusSample> samples;
};

/// Throws std::runtime_error with the line that breaks the format.
inline std::map<std::string, PrometheusFamily> read_prometheus(const std::string& text) {
  std::map<std::string, PrometheusFamily> out;
  if (text.empty() || text.back() != '\n') throw std::runtime_error("does not end with a line end");
  std::istringstream lines(text);
  std::string family;
  for (std::string line; std::getline(lines, line);) {
    const auto refuse = [&](const std::string& why) {
      throw std::runtime_error(why + ": " + line);
    };
    std::size_t at = 0;
    const auto word = [&] {
      const std::size_t begin = at;
      while (at < line.size() && (std::isalnum(static_cast<unsigned char>(line[at])) != 0 ||
                                  line[at] == '_' || line[at] == ':'))
        ++at;
      if (at == begin || std::isdigit(static_cast<unsigned char>(line[begin])) != 0)
        refuse("no name");
      return line.substr(begin, at - begin);
    };
    const auto expect = [&](char c) {
      if (at >= line.size() || line[at] != c) refuse(std::string("no ") + c);
      ++at;
    };
    if (line.starts_with("# HELP ")) {
      at = 7;
      family = word();
      expect(' ');
      if (out.contains(family)) refuse("described twice");
      out[family].help = line.substr(at);
    } else if (line.starts_with("# TYPE ")) {
      at = 7;
      if (word() != family) refuse("type of another metric");
      expect(' ');
      out[family].type = line.substr(at);
      const std::string& type = out[family].type;
      if (type != "counter" && type != "gauge" && type != "histogram") refuse("no such type");
    } else {
      PrometheusSample sample;
      sample.name = word();
      std::string base = sample.name;
      if (!family.empty() && out[family].type == "histogram") {
        for (const char* suffix : {"_bucket", "_sum", "_count"}) {
          if (base == family + suffix) base = family;
        }
      }
      if (base != family) refuse("sample of another metric");
      if (at < line.size() && line[at] == '{') {
        ++at;
        while (true) {
          const std::string name = word();
          expect('=');
          expect('"');
          std::string value;
          while (at < line.size() && line[at] != '"') {
            if (line[at] == '\\') {
              ++at;
              if (at >= line.size()) refuse("ends in a label");
              const char c = line[at++];
              if (c != '\\' && c != '"' && c != 'n') refuse("no such escape");
              value += c == 'n' ? '\n' : c;
            } else {
              value += line[at++];
            }
          }
          expect('"');
          if (!sample.labels.emplace(name, value).second) refuse("label twice");
          if (at < line.size() && line[at] == ',') {
            ++at;
            continue;
          }
          expect('}');
          break;
        }
      }
      expect(' ');
      const std::string value = line.substr(at);
      std::size_t used = 0;
      try {
        sample.value = std::stod(value, &used);
      } catch (const std::exception&) {
        refuse("no number");
      }
      if (used != value.size()) refuse("more than a number");
      for (const PrometheusSample& other : out[family].samples) {
        if (other.name == sample.name && other.labels == sample.labels) refuse("sample twice");
      }
      out[family].samples.push_back(sample);
    }
  }
  return out;
}

}  // namespace servotwin::daemon
