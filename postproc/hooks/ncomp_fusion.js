// Fusion (and Inventor CAM, HSMWorks) post-processor: the program of a post, corrected by ncomp when it is complete.
//
// Append this text to the post's .cps file, and set the options of `ncomp correct` here, with the whole paths of files:
var ncompCommand = "ncomp";
var ncompOptions = "--machine mill.toml --calibration cal.json";
//
// The post writes part.posted, and ncomp alone writes part.nc: complete, or not at all. An older part.nc is removed first.
extension = "posted";
var ncompExtension = "nc";

// The post's own end, if it has one, runs first.
var ncompOnTerminate = typeof onTerminate == "function" ? onTerminate : undefined;
onTerminate = function () {
  if (ncompOnTerminate) {
    ncompOnTerminate();
  }
  var posted = getOutputPath();
  var output = FileSystem.replaceExtension(posted, ncompExtension);
  if (FileSystem.isFile(output)) {
    FileSystem.remove(output);
  }
  var status = execute(ncompCommand, "correct \"" + posted + "\" -o \"" + output + "\" " + ncompOptions, false, "");
  if (status != 0 || !FileSystem.isFile(output)) {
    error("ncomp ended with status " + status + ": no program was written. Run it by hand to see the reason: " +
      ncompCommand + " correct \"" + posted + "\" " + ncompOptions);
  }
};
