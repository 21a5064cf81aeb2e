%TNCscopeNT data file
%[CURVE1]
%NAME=s soll/Y
%CHANNELTYPE=s soll
%AXISTYPE=Y
%DIMENSION=mm
%COLUMN=1
%[DATA]
 0.0e+000;  4.0e+002; 
 3.0e+003;  4.1e+002; 
