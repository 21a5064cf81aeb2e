# Writes OUT, a C++ source with the files that every unit has as arrays (cli/export/unit_files.h).
#   cmake -DOUT=unit_files.cpp -DSOURCES=cli/export/sources -DLIBRARY=libunit.so -DLICENCE=LICENSE -P embed_unit.cmake
file(GLOB sources RELATIVE ${SOURCES} ${SOURCES}/*.c ${SOURCES}/*.h)

set(arrays "")
set(table "")
set(number 0)
function(embed name file)
  file(READ ${file} bytes HEX)
  string(LENGTH "${bytes}" length)
  math(EXPR length "${length} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "(................................................................................)" "\\1\n" bytes "${bytes}")
  string(APPEND arrays "constexpr unsigned char kFile${number}[] = {\n${bytes}0};\n")
  string(APPEND table "    {${name}, text(kFile${number}, ${length})},\n")
  math(EXPR number "${number} + 1")
  set(arrays "${arrays}" PARENT_SCOPE)
  set(table "${table}" PARENT_SCOPE)
  set(number ${number} PARENT_SCOPE)
endfunction()

embed(kUnitLibrary ${LIBRARY})
embed(kUnitLicence ${LICENCE})
foreach(file IN LISTS sources)
  embed("\"${file}\"" ${SOURCES}/${file})
endforeach()

file(WRITE ${OUT} "// Made by cli/export/embed_unit.cmake.
#include \"cli/export/unit_files.h\"

#include <array>
#include <cstddef>

namespace servotwin {
namespace {

${arrays}
std::string_view text(const unsigned char* bytes, std::size_t count) {
  return {reinterpret_cast<const char*>(bytes), count};
}

}  // namespace

std::span<const UnitFile> unit_files() noexcept {
  static const auto files = std::to_array<UnitFile>({
${table}  });
  return files;
}

}  // namespace servotwin
")
