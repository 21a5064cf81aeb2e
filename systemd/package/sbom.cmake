# Writes OUT, a software bill of materials (SPDX 2.3, JSON) of the programs as they are linked.
#   cmake -DOUT=F -DVERSION=V -DCREATED=TIME -DPROGRAMS="A;B" -DCOPYRIGHT=F -DPAGE=package-lock.json -P sbom.cmake
# Shared libraries: those that the dynamic loader finds for the programs. Headers and static libraries: the paths in
# COPYRIGHT, which tests/package compares with what the compiler has read. Licences are those of COPYRIGHT; of a library
# that only another library needs, the licence is in that Debian package.
cmake_minimum_required(VERSION 3.25)

set(packages "")
set(relations "")
set(seen "")

# Adds a component once; `locator` is its package URL, `relation` how the programs use it.
function(add_component name version licence supplier locator relation)
  string(REGEX REPLACE "[^A-Za-z0-9.-]" "-" id "SPDXRef-${name}")
  if(id IN_LIST seen)
    return()
  endif()
  string(APPEND packages ",
    {
      \"SPDXID\": \"${id}\",
      \"name\": \"${name}\",
      \"versionInfo\": \"${version}\",
      \"supplier\": \"${supplier}\",
      \"downloadLocation\": \"NOASSERTION\",
      \"filesAnalyzed\": false,
      \"licenseConcluded\": \"${licence}\",
      \"licenseDeclared\": \"${licence}\",
      \"copyrightText\": \"NOASSERTION\",
      \"primaryPackagePurpose\": \"LIBRARY\",
      \"externalRefs\": [
        { \"referenceCategory\": \"PACKAGE-MANAGER\", \"referenceType\": \"purl\", \"referenceLocator\": \"${locator}\" }
      ]
    }")
  if(relation STREQUAL "RUNTIME_DEPENDENCY_OF")
    set(from ${id})
    set(to SPDXRef-servotwin)
  else()
    set(from SPDXRef-servotwin)
    set(to ${id})
  endif()
  string(APPEND relations ",
    { \"spdxElementId\": \"${from}\", \"relationshipType\": \"${relation}\", \"relatedSpdxElement\": \"${to}\" }")
  set(seen ${seen} ${id} PARENT_SCOPE)
  set(packages "${packages}" PARENT_SCOPE)
  set(relations "${relations}" PARENT_SCOPE)
endfunction()

# Adds the Debian package that has a file; find_owners() knows it.
function(add_file_of_debian path licence relation)
  set(name ${owner_of_${path}})
  if(NOT name)
    message(FATAL_ERROR "${path}: a library of the programs that is in no Debian package")
  endif()
  string(REPLACE "+" "%2B" locator "pkg:deb/debian/${name}@${version_of_${name}}")
  string(REGEX REPLACE "@([0-9]+):" "@\\1%3A" locator "${locator}")
  string(REGEX REPLACE "\\?.*" "" version ${version_of_${name}})
  add_component(${name} ${version} "${licence}" "Organization: Debian" "${locator}&distro=debian-12" ${relation})
  foreach(result seen packages relations)
    set(${result} "${${result}}" PARENT_SCOPE)
  endforeach()
endfunction()

# Asks once, because dpkg reads all of its lists each time: owner_of_PATH, version_of_PACKAGE (with the architecture).
macro(find_owners)
  # A file in /usr/lib may be listed as one in /lib; what is not listed is on the standard error.
  set(listed ${ARGN})
  list(TRANSFORM listed REPLACE "^/usr/lib" "/lib")
  execute_process(COMMAND dpkg-query -S ${ARGN} ${listed} OUTPUT_VARIABLE owners ERROR_QUIET)
  string(REPLACE "\n" ";" owners "${owners}")
  set(names "")
  foreach(line ${owners})
    if(line MATCHES "^([^:, ]+).*: /(usr/)?([^ ]+)$")
      set(owner_of_/usr/${CMAKE_MATCH_3} ${CMAKE_MATCH_1})
      list(APPEND names ${CMAKE_MATCH_1})
    endif()
  endforeach()
  execute_process(COMMAND dpkg-query -W -f "\${Package} \${Version}?arch=\${Architecture}\n" ${names}
    OUTPUT_VARIABLE versions COMMAND_ERROR_IS_FATAL ANY)
  string(REPLACE "\n" ";" versions "${versions}")
  foreach(line ${versions})
    string(REPLACE " " ";" line "${line}")
    list(GET line 0 name)
    list(GET line 1 version_of_${name})
  endforeach()
endmacro()

# What COPYRIGHT says of files outside of the tree: lists of patterns and, at the same place, of licences.
file(READ ${COPYRIGHT} text)
string(REPLACE ";" "," text "${text}")
string(REPLACE "\n\n" ";" paragraphs "${text}")
set(patterns "")
set(licences "")
foreach(paragraph ${paragraphs})
  if(paragraph MATCHES "^Files: (/[^\n]*)")
    string(REPLACE " " ";" files "${CMAKE_MATCH_1}")
    string(REGEX MATCH "\nLicense: ([^\n]*)" unused "${paragraph}")
    string(REPLACE " and " " AND " licence "${CMAKE_MATCH_1}")
    string(REPLACE " or " " OR " licence "${licence}")
    string(REPLACE " with " " WITH " licence "${licence}")
    foreach(file ${files})
      list(APPEND patterns ${file})
      list(APPEND licences ${licence})
    endforeach()
  endif()
endforeach()

file(GET_RUNTIME_DEPENDENCIES EXECUTABLES ${PROGRAMS} RESOLVED_DEPENDENCIES_VAR libraries
  UNRESOLVED_DEPENDENCIES_VAR missing)
if(missing)
  message(FATAL_ERROR "libraries of the programs that are not found: ${missing}")
endif()
set(direct "")
foreach(program ${PROGRAMS})
  execute_process(COMMAND objdump -p ${program} OUTPUT_VARIABLE headers COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "NEEDED +[^\n]+" needed "${headers}")
  list(APPEND direct ${needed})
endforeach()
list(TRANSFORM direct REPLACE "NEEDED +" "")

file(READ ${PAGE} page)
string(JSON uplot GET "${page}" packages node_modules/uplot version)
add_component(uplot ${uplot} MIT "Organization: uPlot" "pkg:npm/uplot@${uplot}" CONTAINS)

list(SORT libraries)
set(reals "")
foreach(library ${libraries})
  get_filename_component(real ${library} REALPATH)
  list(APPEND reals ${real})
endforeach()
set(paths "")
foreach(pattern ${patterns})
  if(NOT pattern MATCHES "\\.so")
    string(REGEX REPLACE "/\\*$" "" pattern ${pattern})
    file(GLOB found ${pattern})
    if(NOT found)
      message(FATAL_ERROR "${COPYRIGHT}: there is no ${pattern}")
    endif()
    list(GET found 0 path)
    list(APPEND paths ${path})
  endif()
endforeach()
find_owners(${paths} ${reals})

foreach(pattern licence IN ZIP_LISTS patterns licences)
  if(NOT pattern MATCHES "\\.so")
    list(POP_FRONT paths path)
    if(path MATCHES "\\.a$")
      add_file_of_debian(${path} "${licence}" STATIC_LINK)
    else()
      add_file_of_debian(${path} "${licence}" CONTAINS)
    endif()
  endif()
endforeach()

# Those that the programs name come first: a package is in the list once, with its closest relation.
foreach(relation DYNAMIC_LINK RUNTIME_DEPENDENCY_OF)
  foreach(library real IN ZIP_LISTS libraries reals)
    get_filename_component(name ${library} NAME)
    set(licence NOASSERTION)
    foreach(pattern declared IN ZIP_LISTS patterns licences)
      string(REGEX REPLACE ".*/" "" file ${pattern})
      if(file STREQUAL name)
        set(licence ${declared})
      endif()
    endforeach()
    if(relation STREQUAL "DYNAMIC_LINK" AND NOT name IN_LIST direct)
      continue()
    endif()
    if(name IN_LIST direct AND licence STREQUAL "NOASSERTION")
      message(FATAL_ERROR "${COPYRIGHT}: names no licence of ${name}, which the programs link")
    endif()
    add_file_of_debian(${real} "${licence}" ${relation})
  endforeach()
endforeach()

string(SHA256 content "${VERSION}${packages}")
string(SUBSTRING ${content} 0 32 content)
file(WRITE ${OUT} "{
  \"spdxVersion\": \"SPDX-2.3\",
  \"dataLicense\": \"CC0-1.0\",
  \"SPDXID\": \"SPDXRef-DOCUMENT\",
  \"name\": \"servotwin-${VERSION}\",
  \"documentNamespace\": \"https://servotwin.example/spdx/servotwin-${VERSION}-${content}\",
  \"creationInfo\": {
    \"created\": \"${CREATED}\",
    \"creators\": [\"Organization: Servotwin maintainers\", \"Tool: systemd/package/sbom.cmake-${VERSION}\"]
  },
  \"packages\": [
    {
      \"SPDXID\": \"SPDXRef-servotwin\",
      \"name\": \"servotwin\",
      \"versionInfo\": \"${VERSION}\",
      \"supplier\": \"Organization: Servotwin maintainers\",
      \"downloadLocation\": \"NOASSERTION\",
      \"filesAnalyzed\": false,
      \"licenseConcluded\": \"Apache-2.0\",
      \"licenseDeclared\": \"Apache-2.0\",
      \"copyrightText\": \"2026 the Servotwin authors\",
      \"primaryPackagePurpose\": \"APPLICATION\",
      \"externalRefs\": [
        { \"referenceCategory\": \"PACKAGE-MANAGER\", \"referenceType\": \"purl\", \"referenceLocator\": \"pkg:deb/servotwin@${VERSION}\" }
      ]
    }${packages}
  ],
  \"relationships\": [
    { \"spdxElementId\": \"SPDXRef-DOCUMENT\", \"relationshipType\": \"DESCRIBES\", \"relatedSpdxElement\": \"SPDXRef-servotwin\" }${relations}
  ]
}
")
