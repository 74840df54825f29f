// Figures are drawn while the page is read, before it has its final width; a finger that strokes one scrolls the page;
// and for printing each is fitted to its column, and what is folded away is shown.
(function(){
  var all=function(f){document.querySelectorAll('.js-plotly-plot').forEach(f)},
    finger=matchMedia('(pointer:coarse)').matches;
  addEventListener('load',function(){all(function(p){Plotly.Plots.resize(p);if(finger)Plotly.relayout(p,{dragmode:false})})});
  addEventListener('beforeprint',function(){
    document.querySelectorAll('details').forEach(function(d){d.open=true});
    all(function(p){var half=p.closest('.grid');Plotly.relayout(p,{width:half?335:690,autosize:false})});
  });
  addEventListener('afterprint',function(){all(function(p){Plotly.relayout(p,{width:null,autosize:true})})});
})();
