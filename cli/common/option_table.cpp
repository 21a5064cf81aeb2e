#include "cli/common/option_table.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <sstream>

#include "drivers/common/text.h"

namespace servotwin::cli {

TableOption& TableOption::takes(const std::string& form) {
  option_->type_name(form);
  return *this;
}

TableOption& TableOption::required(bool is_required) {
  option_->required(is_required);
  return *this;
}

TableOption& TableOption::between(double low, double high) {
  option_->check(CLI::Validator(
      [low, high](std::string& input) -> std::string {
        double value = 0.0;
        if (CLI::detail::lexical_cast(input, value) && value >= low && value <= high) return {};
        std::ostringstream out;
        out << in_quotes(input) << " must be a number from " << low << " to " << high;
        return out.str();
      },
      ""));
  return *this;
}

TableOption& TableOption::between(int low, int high) {
  option_->check(CLI::Validator(
      [low, high](std::string& input) -> std::string {
        int value = 0;
        if (CLI::detail::lexical_cast(input, value) && value >= low && value <= high) return {};
        return in_quotes(input) + " must be a whole number from " + std::to_string(low) + " to " +
               std::to_string(high);
      },
      ""));
  return *this;
}

TableOption& TableOption::positive() {
  option_->check(CLI::PositiveNumber.name(""));
  return *this;
}

TableOption& TableOption::not_negative() {
  option_->check(CLI::NonNegativeNumber.name(""));
  return *this;
}

TableOption& TableOption::one_of(const std::vector<std::string>& words) {
  option_->check(CLI::IsMember(words).name(""));
  return *this;
}

TableOption& TableOption::one_of_numbers(const std::vector<int>& numbers) {
  option_->check(CLI::IsMember(numbers).name(""));
  return *this;
}

TableOption& TableOption::comma_separated() {
  option_->delimiter(',');
  return *this;
}

TableOption& TableOption::one_value_each_time() {
  option_->expected(1)->take_all();
  return *this;
}

TableOption& TableOption::value_optional() {
  option_->expected(0, 1);
  return *this;
}

OptionTable::OptionTable(CLI::App& app, const std::string& name, const std::string& what)
    : app_(app.add_subcommand(name, what)) {}

template <class T>
TableOption OptionTable::option(const std::string& name, T& value, const std::string& what) {
  return TableOption(app_->add_option(name, value, what));
}

template TableOption OptionTable::option(const std::string&, int&, const std::string&);
template TableOption OptionTable::option(const std::string&, double&, const std::string&);
template TableOption OptionTable::option(const std::string&, std::uint32_t&, const std::string&);
template TableOption OptionTable::option(const std::string&, std::uint64_t&, const std::string&);
template TableOption OptionTable::option(const std::string&, std::string&, const std::string&);
template TableOption OptionTable::option(const std::string&, std::filesystem::path&,
                                         const std::string&);
template TableOption OptionTable::option(const std::string&, std::optional<double>&,
                                         const std::string&);
template TableOption OptionTable::option(const std::string&, std::vector<double>&,
                                         const std::string&);
template TableOption OptionTable::option(const std::string&, std::vector<std::string>&,
                                         const std::string&);
template TableOption OptionTable::option(const std::string&, std::vector<std::filesystem::path>&,
                                         const std::string&);

TableOption OptionTable::flag(const std::string& name, bool& value, const std::string& what) {
  return TableOption(app_->add_flag(name, value, what));
}

TableOption OptionTable::option_read_by(const std::string& name,
                                        const std::function<void(const std::string&)>& read,
                                        const std::string& what) {
  return TableOption(app_->add_option_function(name, read, what));
}

TableOption OptionTable::declared(const std::string& name) const {
  return TableOption(app_->get_option(name));
}

bool OptionTable::given(const std::string& name) const { return app_->count(name) > 0; }

std::optional<double> number_of(const std::string& word) {
  double value = 0.0;
  if (!CLI::detail::lexical_cast(word, value) || !std::isfinite(value)) return std::nullopt;
  return value;
}

void refuse_value(const std::string& option, const std::string& why) {
  throw CLI::ValidationError(option, why);
}

}  // namespace servotwin::cli
