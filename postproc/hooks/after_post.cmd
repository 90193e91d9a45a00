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
set POSTED=%~f1
set OUTPUT=%~dpn1.nc
cd /d "%~dp0"
if exist "%OUTPUT%" del /q "%OUTPUT%"
%NCOMP% correct "%POSTED%" -o "%OUTPUT%" %OPTIONS%
if errorlevel 1 (
    echo ncomp: no program was written
    pause
    exit /b 2
)
