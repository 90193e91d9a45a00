# NX post-processor: the program of a post, corrected by ncomp when it is complete.
#
# Source this file at the end of the post's event handler (Post Builder: a custom command "PB_CMD_ncomp" with
#     source "C:/ncomp/ncomp_nx.tcl"
# that the start of the program calls), and set the options of `ncomp correct` here, with the whole paths of files:
set ::ncomp_command [list {ncomp}]
set ::ncomp_options [list --machine mill.toml --calibration cal.json]
#
# NX writes part.posted, and ncomp alone writes part.nc: complete, or not at all. An older part.nc is removed first.
set ::ncomp_suffix ".nc"

# Correct the posted program; its path, without the suffix, and ncomp_suffix are the name of the corrected program.
proc ncomp_correct { posted } {
    global ncomp_command ncomp_options ncomp_suffix
    set output "[file rootname $posted]$ncomp_suffix"
    if { $output eq $posted } {
        MOM_abort "ncomp: the post writes $posted, the name of the corrected program: let it write .posted"
        return
    }
    file delete -- $output
    if { [catch { exec -ignorestderr {*}$ncomp_command correct $posted -o $output {*}$ncomp_options 2>@1 } told] } {
        MOM_abort "ncomp: no program was written\n$told"
        return
    }
    MOM_output_to_listing_device $told
}

# The end of the post's program stays as it is; after it the file is closed and corrected.
if { [llength [info commands MOM_end_of_program]] && ![llength [info commands ncomp_end_of_program]] } {
    rename MOM_end_of_program ncomp_end_of_program
    proc MOM_end_of_program {} {
        global mom_output_file_full_name
        ncomp_end_of_program
        MOM_close_output_file $mom_output_file_full_name
        ncomp_correct $mom_output_file_full_name
    }
}
