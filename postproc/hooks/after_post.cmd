@echo off
rem Windows: a posted program, corrected by ncomp. Call it with the posted file, or drop the file on it:
rem     after_post.cmd C:\posted\part.posted
rem The CAM writes part.posted, and ncomp alone writes part.nc: complete, or not at all. An older part.nc is removed first.
setlocal
rem Machine and calibration lie beside this file, or have their whole paths.
set NCOMP="ncomp"
set OPTIONS=--machine mill.toml --calibration cal.json
if /i "%~x1"==".nc" (
    echo ncomp: let the post write .posted: %1 has the name of the corrected program
    pause
    exit /b 2
)
cd /d "%~dp0"
if exist "%~dpn1.nc" del /q "%~dpn1.nc"
%NCOMP% correct "%~1" -o "%~dpn1.nc" %OPTIONS%
if errorlevel 1 (
    echo ncomp: no program was written
    pause
    exit /b 2
)
