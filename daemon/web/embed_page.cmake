# Writes OUT, a C++ source with the FILES of the page as arrays (daemon/web/page.h).
#   cmake -DOUT=page_files.cpp -DPAGE=daemon/web/page -DVENDOR=daemon/web/vendor -P embed_page.cmake
file(GLOB page LIST_DIRECTORIES false RELATIVE ${PAGE} ${PAGE}/*)
file(GLOB_RECURSE vendor RELATIVE ${VENDOR} ${VENDOR}/*.js ${VENDOR}/*.css ${VENDOR}/*/LICENSE)

set(arrays "")
set(table "")
set(number 0)
function(embed folder file path)
  if(file MATCHES "\\.html$")
    set(type "text/html; charset=utf-8")
  elseif(file MATCHES "\\.js$")
    set(type "text/javascript; charset=utf-8")
  elseif(file MATCHES "\\.css$")
    set(type "text/css; charset=utf-8")
  elseif(file MATCHES "\\.svg$")
    set(type "image/svg+xml")
  elseif(file MATCHES "LICENSE$")
    set(type "text/plain; charset=utf-8")
  else()
    message(FATAL_ERROR "${folder}/${file}: unknown file type")
  endif()
  file(READ ${folder}/${file} bytes HEX)
  file(SHA256 ${folder}/${file} hash)
  string(SUBSTRING ${hash} 0 16 tag)
  string(LENGTH "${bytes}" length)
  math(EXPR length "${length} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "(................................................................................)" "\\1\n" bytes "${bytes}")
  string(APPEND arrays "constexpr unsigned char kFile${number}[] = {\n${bytes}0};\n")
  string(APPEND table "    {\"${path}\", \"${type}\", \"\\\"${tag}\\\"\", text(kFile${number}, ${length})},\n")
  math(EXPR number "${number} + 1")
  set(arrays "${arrays}" PARENT_SCOPE)
  set(table "${table}" PARENT_SCOPE)
  set(number ${number} PARENT_SCOPE)
endfunction()

foreach(file IN LISTS page)
  if(file STREQUAL "index.html")
    embed(${PAGE} ${file} "/")
  else()
    embed(${PAGE} ${file} "/${file}")
  endif()
endforeach()
foreach(file IN LISTS vendor)
  embed(${VENDOR} ${file} "/vendor/${file}")
endforeach()

file(WRITE ${OUT} "// Made by daemon/web/embed_page.cmake.
#include \"daemon/web/page.h\"

#include <array>
#include <cstddef>

namespace servotwin::daemon {
namespace {

${arrays}
std::string_view text(const unsigned char* bytes, std::size_t count) {
  return {reinterpret_cast<const char*>(bytes), count};
}

}  // namespace

std::span<const PageFile> page_files() noexcept {
  static const auto files = std::to_array<PageFile>({
${table}  });
  return files;
}

}  // namespace servotwin::daemon
")
