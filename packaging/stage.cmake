# Runs between installing and packing: what Debian wants of files that other installations do not have.
set(root ${CPACK_TEMPORARY_DIRECTORY})

file(GLOB_RECURSE texts ${root}/*.1 ${root}/changelog.Debian)
list(FILTER texts INCLUDE REGEX "/(man1|doc)/")
execute_process(COMMAND gzip -9n ${texts} COMMAND_ERROR_IS_FATAL ANY)

# The dynamic linker knows the folder of Debian's libraries.
file(GLOB_RECURSE binaries ${root}/*)
list(FILTER binaries INCLUDE REGEX "/bin/|\\.so")
foreach(binary IN LISTS binaries)
  if(NOT IS_SYMLINK ${binary})
    file(RPATH_REMOVE FILE ${binary})
  endif()
endforeach()

execute_process(COMMAND find ${root} -exec touch --no-dereference --date=@$ENV{SOURCE_DATE_EPOCH} {} + COMMAND_ERROR_IS_FATAL ANY)
